"""What a bench declares of the chains behind its sensors: as a log keeps it, and as it shapes a prediction.

A run's twin and that of its log are told by the same record, so that both predict the same bits.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Final

from daq.log.metadata import as_table, number_in, read_json
from daq.log.records import RANGE, SENSITIVITY
from daq.quantity import Bound, Quantity, Whole, Words, seconds, settings_of
from drivers.canopen_cia406.settings import EncoderIdentity, EncoderSettings
from drivers.ni_daq.channels import (
    INPUT_NOISE_V,
    Amplifier,
    AntiAliasFilter,
    CardChannel,
    Mark,
    Pulses,
    Resonance,
    input_range_v,
)
from drivers.ni_daq.sensing import sort_of_input
from rig.files.bench import Bench
from rig.files.quantity import si_factor
from rig.twin.alignment import Mounting
from sim_twin.rigs.channel_table import ENCODER_ANGLE, ChannelTable
from sim_twin.sensors import Encoder, SensorChain
from sim_twin.stages import Stages
from sim_twin.twin import AnyTwin

CHAIN: Final = "chain."
_STINGER: Final = "stinger"
_FINE: Final = 2**24
"""Counts of an encoder that nobody knows the counts of."""


def chain_record(bench: Bench, sample_rate: float) -> dict[str, str]:
    """What the log's `run` record keeps of chains of which the bench says more than a scale; JSON in SI.

    `sample_rate` is the card's, which makes a time in s of one that the bench has in samples.
    """
    kept = {channel.name: _stated(channel, sample_rate) for channel in bench.daq_card.channels}
    if (encoder := bench.encoder) is not None and encoder.mounting is not None:
        counts = encoder.identity.counts_per_revolution
        own = {"counts": counts} if counts else {}
        kept[ENCODER_ANGLE.name] = own | {"mounting_rad": encoder.mounting, "backwards": encoder.backwards}
    return {f"{CHAIN}{name}": json.dumps(stated, sort_keys=True) for name, stated in kept.items() if stated}


def scale_record(bench: Bench) -> dict[str, str]:
    """What it keeps of the scale of every channel: V per unit, and the full scale."""
    channels = [channel for channel in bench.daq_card.channels if channel.pulses is None]
    volts = {SENSITIVITY + channel.name: repr(channel.volts_per_unit) for channel in channels}
    return volts | {RANGE + channel.name: repr(channel.range) for channel in channels}


def declared_by(bench: Bench, sample_rate: float) -> dict[str, str]:
    """All that a log of this bench says of its chains."""
    return chain_record(bench, sample_rate) | scale_record(bench)


def _stated(channel: CardChannel, sample_rate: float) -> dict[str, object]:
    amplifier, low_pass, pulses, mark = channel.amplifier, channel.anti_alias, channel.pulses, channel.mark
    delay_s = seconds(channel.delay, sample_rate)
    own, resonance = (channel.corner_hz, delay_s, channel.in_stinger), channel.resonance
    if not (amplifier or low_pass or channel.counted or mark or resonance or any(own)):
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
        "resonance_hz": resonance and resonance.frequency_hz,
        "resonance_damping": resonance and resonance.damping_ratio,
        "delay_s": delay_s,
    }
    return {key: value for key, value in chain.items() if value}


def mounting_of(record: Mapping[str, str], channels: ChannelTable) -> Mounting:
    """How what shows the cycles is mounted, by a `run` record; raises LogError like `chain_of`."""
    gauged = chain_of(record, channels.drive).told.get("senses") == _STINGER
    return Mounting(gauged, chain_of(record, channels.marker).number("mark.angle_rad") or 0.0)


def mounted(twin: AnyTwin, record: Mapping[str, str]) -> AnyTwin:
    """`twin` with its sensors where the record says that they sit."""
    mounting, places = mounting_of(record, twin.model.channels), dict[str, Any]()
    if mounting.mark_rad:
        places["marker_angle"] = mounting.mark_rad
    if mounting.gauged:
        places["stinger_gauge"] = True
    return replace(twin, rig=replace(twin.rig, **places)) if places else twin


def with_chains(twin: AnyTwin, record: Mapping[str, str]) -> AnyTwin:
    """`twin` as the instruments of a `run` record show it; raises LogError for one that cannot be read."""
    twin = mounted(twin, record)
    shown = {name: _shown(twin.sensors.get(name, SensorChain()), name, record) for name in twin.channels}
    changed = {name: sensor for name, sensor in shown.items() if sensor is not None}
    if (encoder := _beside(twin, chain_of(record, ENCODER_ANGLE.name))) is not None:
        changed[ENCODER_ANGLE.name] = encoder
    return replace(twin, sensors={**twin.sensors, **changed}) if changed else twin


def _beside(twin: AnyTwin, chain: Chain) -> Encoder | None:
    """The encoder that sends by itself, of which a log says how it is mounted: what it shows at the mark."""
    mounting, counts = chain.number("mounting_rad"), chain.number("counts")
    if mounting is None or not twin.model.channels.marker:
        return None
    backwards = bool(chain.told.get("backwards"))
    mark = float(getattr(twin.rig, "marker_angle", 0.0))
    return Encoder(round(counts or _FINE), backwards, mark + (mounting if backwards else -mounting))


def _shown(sensor: Any, name: str, record: Mapping[str, str]) -> Any:
    """The sensor with what a record says of its channel; None where that is nothing."""
    chain = chain_of(record, name)
    if isinstance(sensor, Encoder):
        pulses, tracks = chain.part("pulses"), round(chain.number("pulses.per_revolution") or 0)
        zero = chain.number("pulses.initial_angle_rad") if pulses.get("index") else None
        counts = tracks * round(chain.number("pulses.decoding") or 0)
        return Encoder(counts, bool(pulses.get("backwards")), zero or 0.0) if counts else None
    scale, largest = scale_of(record, SENSITIVITY, name), scale_of(record, RANGE, name)
    if sort_of_input(str(chain.told.get("physical", ""))) == "ctr":
        if each_turn := chain.number("pulses.per_revolution"):
            return replace(sensor, noise=0.0, pulses=each_turn)
        return replace(sensor, edges=largest) if largest and 0.0 < largest < inf else None
    limit, stages = inf, stages_of(record, name)
    if scale and largest and largest < inf and not chain.part("mark"):
        limit = input_range_v(scale * largest) / scale
    if stages == Stages() and limit == inf:
        return None
    return replace(sensor, stages=None if stages == Stages() else stages, limit=limit)


def stages_of(record: Mapping[str, str], name: str) -> Stages:
    """What a `run` record says of the stages of an analog channel; raises LogError like `chain_of`."""
    chain, scale = chain_of(record, name), scale_of(record, SENSITIVITY, name)
    corners = chain.number("amplifier.corner_hz"), chain.number("corner_hz")
    corner, order = chain.number("filter.corner_hz"), chain.number("filter.order")
    output_v = chain.number("amplifier.output_v")
    own_hz, damping = chain.number("resonance_hz"), chain.number("resonance_damping")
    return Stages(
        resonance=None if own_hz is None else (own_hz, damping or Resonance(own_hz).damping_ratio),
        high_passes=tuple(each for each in corners if each),
        output=output_v / scale if scale and output_v else inf,
        low_pass=(corner, round(order)) if corner and order else None,
        late=chain.number("delay_s") or 0.0,
        floor=INPUT_NOISE_V / scale if scale and corner else 0.0,
    )


_DECLARED: Final[Mapping[str, tuple[type[Any], str]]] = {
    "mark.angle_rad": (Mark, "angle"),
    "pulses.per_revolution": (Pulses, "per_revolution"),
    "pulses.decoding": (Pulses, "decoding"),
    "pulses.initial_angle_rad": (Pulses, "initial_angle"),
    "amplifier.corner_hz": (Amplifier, "corner_hz"),
    "amplifier.output_v": (Amplifier, "output_v"),
    "filter.corner_hz": (AntiAliasFilter, "corner_hz"),
    "filter.order": (AntiAliasFilter, "order"),
    "corner_hz": (CardChannel, "corner_hz"),
    "resonance_hz": (Resonance, "frequency_hz"),
    "resonance_damping": (Resonance, "damping_ratio"),
    "delay_s": (CardChannel, "delay"),
    "counts": (EncoderIdentity, "counts_per_revolution"),
    "mounting_rad": (EncoderSettings, "mounting"),
}
"""What a bench file declares each number as."""


@dataclass(frozen=True, slots=True)
class Chain:
    """What a log says of a chain, named as `what`; its numbers are in SI."""

    what: str
    told: Mapping[str, Any]

    def part(self, name: str) -> Mapping[str, Any]:
        """The table of an amplifier, filter, mark or source of pulses; raises LogError where it is none."""
        return as_table(self.told.get(name) or {}, self.what)

    def number(self, key: str) -> float | None:
        """None where it is not there; raises LogError for one that no bench may declare."""
        part, _, last = key.rpartition(".")
        table = self.part(part) if part else self.told
        return None if table.get(last) is None else number_in(table, last, _bound_of(key), self.what)


def _bound_of(key: str) -> Bound:
    """In SI, as a log has it."""
    owner, name = _DECLARED[key]
    setting = next(each for each in settings_of(owner).values() if each.name == name)
    match setting.meaning:
        case Quantity(unit=unit, low=low, high=high, above=above):
            return Bound("", low * si_factor(unit), high * si_factor(unit), above)
        case Words(values=dict(words)):
            return Bound("", min(words.values()), max(words.values()))
        case Whole(low=low, high=high):
            return Bound("", low, high)
    raise TypeError(f"{key} is no number in a bench file")


def chain_of(record: Mapping[str, str], name: str) -> Chain:
    """What a `run` record says of the chain of a channel; raises LogError where that cannot be read."""
    what = f"what the log says of the chain of {name}"
    return Chain(what, as_table(read_json(record.get(f"{CHAIN}{name}", "{}"), what), what))


def scale_of(record: Mapping[str, str], what: str, name: str) -> float | None:
    """SENSITIVITY (V per unit) or RANGE (its unit) of a channel by a `run` record; None if not there."""
    try:
        return float(record[what + name])
    except (KeyError, ValueError):
        return None
