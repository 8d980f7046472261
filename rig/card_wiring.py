"""From the card's channels in a bench file to driver settings, emulated wires and the log's record."""

from __future__ import annotations

import json
from typing import Final

from drivers.ni_daq.channels import CardChannel
from drivers.ni_daq.emulator.wiring import CardWiring, ChargeStage, CounterWire, LowPassStage, Wire
from rig.files.bench import Bench

# An input takes 5 V or, with the modules for larger signals, 10 V.
_RANGES_V: Final = (5.0, 10.0)


def wiring_of(bench: Bench) -> CardWiring:
    """The emulated card's inputs: each channel of the bench with the chain that the bench states."""
    channels = bench.daq_card.channels
    return CardWiring(
        {channel.physical: _wire(channel) for channel in channels if not channel.counted},
        counters={channel.physical: _counter_wire(channel) for channel in channels if channel.counted},
    )


def _wire(channel: CardChannel) -> Wire:
    amplifier, low_pass = channel.amplifier, channel.anti_alias
    widest_v = _RANGES_V[-1]
    return Wire(
        channel.name,
        channel.volts_per_unit,
        range_v=next((range_v for range_v in _RANGES_V if channel.full_scale_v <= range_v), widest_v),
        charge=None
        if amplifier is None
        else ChargeStage(amplifier.corner_hz, amplifier.output_v or _RANGES_V[-1]),
        low_pass=None if low_pass is None else LowPassStage(low_pass.corner_hz, low_pass.order),
    )


def _counter_wire(channel: CardChannel) -> CounterWire:
    if channel.pulses is None:
        return CounterWire(channel.name, threshold_v=channel.range / 2.0)
    return CounterWire(channel.name, channel.pulses.per_revolution)


def chain_record(bench: Bench) -> dict[str, str]:
    """What the log's `run` record keeps of chains with stages of their own, and of counters; JSON in SI."""
    return {
        f"chain.{channel.name}": json.dumps(_chain(channel), sort_keys=True)
        for channel in bench.daq_card.channels
        if channel.amplifier or channel.anti_alias or channel.counted
    }


def _chain(channel: CardChannel) -> dict[str, object]:
    amplifier, low_pass, pulses = channel.amplifier, channel.anti_alias, channel.pulses
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
    return {key: value for key, value in chain.items() if value}
