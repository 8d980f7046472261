"""What a bench declares of the chains behind its sensors: as a log keeps it, and as it shapes a prediction.

A run's twin and that of its log are told by the same record, so that both predict the same bits.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Any, Final

from daq.errors import LogError
from daq.log.records import RANGE, SENSITIVITY
from drivers.ni_daq.channels import INPUT_NOISE_V, CardChannel, input_range_v
from rig.files.bench import Bench
from sim_twin.rigs.channel_table import ENCODER_ANGLE
from sim_twin.sensors import Encoder, SensorChain
from sim_twin.stages import Stages
from sim_twin.twin import AnyTwin

_CHAIN: Final = "chain."
_STINGER: Final = "stinger"
_FINE: Final = 2**24
"""Counts of an encoder that nobody knows the counts of."""


def chain_record(bench: Bench) -> dict[str, str]:
    """What the log's `run` record keeps of chains of which the bench says more than a scale; JSON in SI."""
    kept = {channel.name: _stated(channel) for channel in bench.daq_card.channels}
    if (encoder := bench.encoder) is not None and encoder.mounting is not None:
        counts = encoder.identity.counts_per_revolution
        own = {"counts": counts} if counts else {}
        kept[ENCODER_ANGLE.name] = own | {"mounting_rad": encoder.mounting, "backwards": encoder.backwards}
    return {f"{_CHAIN}{name}": json.dumps(stated, sort_keys=True) for name, stated in kept.items() if stated}


def scale_record(bench: Bench) -> dict[str, str]:
    """What it keeps of the scale of every channel: V per unit, and the full scale."""
    channels = [channel for channel in bench.daq_card.channels if channel.pulses is None]
    volts = {SENSITIVITY + channel.name: repr(channel.volts_per_unit) for channel in channels}
    return volts | {RANGE + channel.name: repr(channel.range) for channel in channels}


def declared_by(bench: Bench) -> dict[str, str]:
    """All that a log of this bench says of its chains."""
    return chain_record(bench) | scale_record(bench)


def _stated(channel: CardChannel) -> dict[str, object]:
    amplifier, low_pass, pulses, mark = channel.amplifier, channel.anti_alias, channel.pulses, channel.mark
    own = (channel.corner_hz, channel.resonance_hz, channel.delay_s, channel.in_stinger)
    if not (amplifier or low_pass or channel.counted or mark or any(own)):
        return {}
    chain: dict[str, object] = {
        "physical": channel.physical,
        "kind": channel.kind,
        "serial": channel.serial,
        "calibrated": channel.calibrated and channel.calibrated.isoformat(),
        "amplifier": amplifier
        and {
            "serial": amplifier.serial,
            "gain_v_per_c": channel.gain,
            "corner_hz": amplifier.corner_hz,
            "output_v": amplifier.output_v,
            "state": amplifier.state,
        },
        "filter": low_pass
        and {"serial": low_pass.serial, "corner_hz": low_pass.corner_hz, "order": low_pass.order},
        "pulses": pulses
        and {
            "per_revolution": pulses.per_revolution,
            "decoding": pulses.decoding,
            "index": pulses.index,
            "initial_angle_rad": pulses.initial_angle,
            **({"backwards": True} if pulses.backwards else {}),
        },
        "mark": mark and {"angle_rad": mark.angle, "level_v": mark.level, "falling": mark.falling},
        "senses": _STINGER if channel.in_stinger else "",
        "corner_hz": channel.corner_hz,
        "resonance_hz": channel.resonance_hz,
        "delay_s": channel.delay_s,
    }
    return {key: value for key, value in chain.items() if value}


def gauged(record: Mapping[str, str], drive: str) -> bool:
    """Whether a gauge in the stinger shows the channel of the `drive`, by a `run` record."""
    return _chain(record, drive).get("senses") == _STINGER


def mounted(twin: AnyTwin, record: Mapping[str, str]) -> AnyTwin:
    """`twin` with its sensors where the record says that they sit."""
    channels, places = twin.model.channels, dict[str, Any]()
    if angle := _number(_chain(record, channels.marker), "mark", "angle_rad"):
        places["marker_angle"] = angle
    if gauged(record, channels.drive):
        places["stinger_gauge"] = True
    return replace(twin, rig=replace(twin.rig, **places)) if places else twin


def with_chains(twin: AnyTwin, record: Mapping[str, str]) -> AnyTwin:
    """`twin` as the instruments of a `run` record show it; raises LogError for one that cannot be read."""
    twin = mounted(twin, record)
    shown = {name: _shown(twin.sensors.get(name, SensorChain()), name, record) for name in twin.channels}
    changed = {name: sensor for name, sensor in shown.items() if sensor is not None}
    if (encoder := _beside(twin, _chain(record, ENCODER_ANGLE.name))) is not None:
        changed[ENCODER_ANGLE.name] = encoder
    return replace(twin, sensors={**twin.sensors, **changed}) if changed else twin


def _beside(twin: AnyTwin, chain: Mapping[str, Any]) -> Encoder | None:
    """The encoder that sends by itself, of which a log says how it is mounted: what it shows at the mark."""
    mounting, counts = _number(chain, "mounting_rad"), _number(chain, "counts")
    if mounting is None or not twin.model.channels.marker:
        return None
    backwards = bool(chain.get("backwards"))
    mark = float(getattr(twin.rig, "marker_angle", 0.0))
    return Encoder(round(counts or _FINE), backwards, mark + (mounting if backwards else -mounting))


def _shown(sensor: Any, name: str, record: Mapping[str, str]) -> Any:
    """The sensor with what a record says of its channel; None where that is nothing."""
    chain = _chain(record, name)
    if isinstance(sensor, Encoder):
        pulses = chain.get("pulses", {})
        tracks, decoding = (_number(chain, "pulses", key) or 0 for key in ("per_revolution", "decoding"))
        zero = _number(chain, "pulses", "initial_angle_rad") if pulses.get("index") else None
        counts = round(tracks * decoding)
        return Encoder(counts, bool(pulses.get("backwards")), zero or 0.0) if counts else None
    scale, largest = scale_of(record, SENSITIVITY, name), scale_of(record, RANGE, name)
    limit, output = inf, inf
    if scale and largest and largest < inf and not chain.get("mark"):
        limit = input_range_v(scale * largest) / scale
    if scale and (output_v := _number(chain, "amplifier", "output_v")):
        output = output_v / scale
    corners = _number(chain, "amplifier", "corner_hz"), _number(chain, "corner_hz")
    corner, order = _number(chain, "filter", "corner_hz"), _number(chain, "filter", "order")
    stages = Stages(
        resonance=_number(chain, "resonance_hz"),
        high_passes=tuple(each for each in corners if each),
        output=output,
        low_pass=(corner, round(order)) if corner and order else None,
        late=_number(chain, "delay_s") or 0.0,
        floor=INPUT_NOISE_V / scale if scale and corner else 0.0,
    )
    if stages == Stages() and limit == inf:
        return None
    return replace(sensor, stages=None if stages == Stages() else stages, limit=limit)


def _chain(record: Mapping[str, str], name: str) -> Mapping[str, Any]:
    text = record.get(f"{_CHAIN}{name}", "{}")
    try:
        chain = json.loads(text)
    except ValueError as error:
        raise LogError(f"what the log says of the chain of {name} cannot be read ({error})") from error
    if not isinstance(chain, dict):
        raise LogError(f"what the log says of the chain of {name} cannot be read: {text[:80]}")
    return chain


def _number(chain: Mapping[str, Any], *keys: str) -> float | None:
    found: Any = chain
    for key in keys:
        found = found.get(key) if isinstance(found, dict) else None
    return float(found) if isinstance(found, int | float) else None


def scale_of(record: Mapping[str, str], what: str, name: str) -> float | None:
    """SENSITIVITY (V per unit) or RANGE (its unit) of a channel by a `run` record; None if not there."""
    try:
        return float(record[what + name])
    except (KeyError, ValueError):
        return None
