"""From the card's channels in a bench file to driver settings, emulated wires and the log's record."""

from __future__ import annotations

import json
from typing import Final

from drivers.ni_daq.emulator.wiring import CardWiring, ChargeStage, CounterWire, LowPassStage, Wire
from rig.files.bench import Bench

# An input takes 5 V or, with the modules for larger signals, 10 V.
_RANGES_V: Final = (5.0, 10.0)


def wiring_of(bench: Bench) -> CardWiring:
    """The emulated card's inputs: each channel of the bench with the chain that the bench states."""
    wires: dict[str, Wire] = {}
    counters: dict[str, CounterWire] = {}
    for channel in bench.daq_card.channels:
        amplifier, low_pass, pulses = channel.amplifier, channel.anti_alias, channel.pulses
        if channel.counted:
            counters[channel.physical] = (
                CounterWire(channel.name, threshold_v=channel.range / 2.0)
                if pulses is None
                else CounterWire(channel.name, pulses.per_revolution)
            )
        else:
            fitting_v = (range_v for range_v in _RANGES_V if channel.full_scale_v <= range_v)
            wires[channel.physical] = Wire(
                channel.name,
                channel.volts_per_unit,
                range_v=next(fitting_v, _RANGES_V[-1]),
                charge=None
                if amplifier is None
                else ChargeStage(amplifier.corner_hz, amplifier.output_v or _RANGES_V[-1]),
                low_pass=None if low_pass is None else LowPassStage(low_pass.corner_hz, low_pass.order),
            )
    return CardWiring(wires, counters=counters)


def chain_record(bench: Bench) -> dict[str, str]:
    """What the log's `run` record keeps of chains with stages of their own, and of counters; JSON in SI."""
    record: dict[str, str] = {}
    for channel in bench.daq_card.channels:
        amplifier, low_pass, pulses = channel.amplifier, channel.anti_alias, channel.pulses
        if not (amplifier or low_pass or channel.counted):
            continue
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
            },
        }
        stated = {key: value for key, value in chain.items() if value}
        record[f"chain.{channel.name}"] = json.dumps(stated, sort_keys=True)
    return record
