"""How each kind of channel is declared to DAQmx, and what comes back from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from nidaqmx.constants import (
    AccelSensitivityUnits,
    AccelUnits,
    AngleUnits,
    EncoderType,
    ExcitationSource,
    ForceIEPESensorSensitivityUnits,
    ForceUnits,
    FrequencyUnits,
)
from numpy.typing import DTypeLike

from daq.channel import Channel
from drivers.ni_daq.channels import CardChannel, Pulses
from drivers.ni_daq.counting import Decoder, MarkPulses, UnwrappedCount, angle, speed

STANDARD_GRAVITY = 9.80665  # m/s2, 3rd CGPM 1901; DAQmx takes accelerometer sensitivities per g
LBF = 4.4482216152605  # N, from the pound of 1959 and standard gravity
DECODINGS = MappingProxyType({1: EncoderType.X_1, 2: EncoderType.X_2, 4: EncoderType.X_4})
_SLOWEST = 1e-4  # of a tachometer's range: DAQmx wants to know the lowest frequency, which may not be 0

VOLTS_EACH = ("sensitivity", "range")


@dataclass(frozen=True, slots=True)
class AnalogKind:
    """A sensor on an analog input. With `in_volts` DAQmx delivers volts, else the unit itself.

    `needs` are the fields of a channel that must hold a number above 0. `noisy` inputs never show one code
    for long; `ac_coupled` ones have no mean. `sheet` reads the sensitivity (V per unit) that a TEDS states.
    """

    units: tuple[str, ...]
    add: Callable[[Any, CardChannel], None]
    in_volts: bool = True
    needs: tuple[str, ...] = VOLTS_EACH
    noisy: bool = True
    ac_coupled: bool = False
    sheet: Callable[[Any, CardChannel], float] | None = None

    def scale(self, channel: CardChannel) -> float | None:
        """Unit per volt; None where DAQmx delivers the unit."""
        return 1.0 / channel.volts_per_unit if self.in_volts else None

    @property
    def raw_unit(self) -> str:
        """What `scale` is per."""
        return "V" if self.in_volts else ""


@dataclass(frozen=True, slots=True)
class CounterKind:
    """A source of pulses on a counter: `read` is the reader's method for `dtype`, `decoder` makes values."""

    units: tuple[str, ...]
    add: Callable[[Any, CardChannel], None]
    needs: tuple[str, ...]
    raw_unit: str
    scale: Callable[[CardChannel], float | None]
    decoder: Callable[[CardChannel], Decoder]
    read: str = "read_many_sample_uint32"
    dtype: DTypeLike = np.uint32


Kind: TypeAlias = AnalogKind | CounterKind


def _add_voltage(task: Any, channel: CardChannel) -> None:
    limit_v = channel.range * channel.volts_per_unit
    task.ai_channels.add_ai_voltage_chan(channel.physical, min_val=-limit_v, max_val=limit_v)


def _add_force_iepe(task: Any, channel: CardChannel) -> None:
    task.ai_channels.add_ai_force_iepe_chan(
        channel.physical,
        min_val=-channel.range,
        max_val=channel.range,
        units=ForceUnits.NEWTONS,
        sensitivity=channel.sensitivity * 1e3,
        sensitivity_units=ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON,
        current_excit_source=ExcitationSource.INTERNAL,
        current_excit_val=channel.excitation_a,
    )


def _add_acceleration_iepe(task: Any, channel: CardChannel) -> None:
    task.ai_channels.add_ai_accel_chan(
        channel.physical,
        min_val=-channel.range,
        max_val=channel.range,
        units=AccelUnits.METERS_PER_SECOND_SQUARED,
        sensitivity=channel.sensitivity * STANDARD_GRAVITY * 1e3,
        sensitivity_units=AccelSensitivityUnits.MILLIVOLTS_PER_G,
        current_excit_source=ExcitationSource.INTERNAL,
        current_excit_val=channel.excitation_a,
    )


_VOLTS_PER_N = {
    ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON: 1e-3,
    ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_POUND: 1e-3 / LBF,
}
_VOLTS_PER_M_S2 = {
    AccelSensitivityUnits.MILLIVOLTS_PER_G: 1e-3 / STANDARD_GRAVITY,
    AccelSensitivityUnits.VOLTS_PER_G: 1.0 / STANDARD_GRAVITY,
}


def _force_sheet(task: Any, channel: CardChannel) -> float:
    declared = task.ai_channels.add_teds_ai_force_iepe_chan(
        channel.physical,
        min_val=-channel.range,
        max_val=channel.range,
        units=ForceUnits.NEWTONS,
        current_excit_val=channel.excitation_a,
    )
    one = _VOLTS_PER_N[declared.ai_force_iepe_sensor_sensitivity_units]
    return float(declared.ai_force_iepe_sensor_sensitivity) * one


def _acceleration_sheet(task: Any, channel: CardChannel) -> float:
    declared = task.ai_channels.add_teds_ai_accel_chan(
        channel.physical,
        min_val=-channel.range,
        max_val=channel.range,
        units=AccelUnits.METERS_PER_SECOND_SQUARED,
        current_excit_val=channel.excitation_a,
    )
    return float(declared.ai_accel_sensitivity) * _VOLTS_PER_M_S2[declared.ai_accel_sensitivity_units]


def _add_encoder(task: Any, channel: CardChannel) -> None:
    pulses = _pulses(channel)
    task.ci_channels.add_ci_ang_encoder_chan(
        channel.physical,
        decoding_type=DECODINGS[pulses.decoding],
        zidx_enable=pulses.index,
        zidx_val=pulses.initial_angle,
        units=AngleUnits.RADIANS,
        pulses_per_rev=pulses.per_revolution,
        initial_angle=pulses.initial_angle,
    )


def _angle_decoder(channel: CardChannel) -> Decoder:
    pulses = _pulses(channel)
    # The index takes whole revolutions off the count, and whatever was lost since.
    turns = UnwrappedCount(pulses.counts_per_revolution, 0) if pulses.index else UnwrappedCount()
    return angle(turns, pulses.rad_per_count)


def _add_edges(task: Any, channel: CardChannel) -> None:
    task.ci_channels.add_ci_count_edges_chan(channel.physical)


def _add_frequency(task: Any, channel: CardChannel) -> None:
    highest_hz = channel.range / _rad_per_pulse(channel)
    declared = task.ci_channels.add_ci_freq_chan(
        channel.physical, min_val=highest_hz * _SLOWEST, max_val=highest_hz, units=FrequencyUnits.HZ
    )
    # With it DAQmx wants two pulses between any two samples; without, it gives the last pulse's frequency.
    declared.ci_freq_enable_averaging = False


def _pulses(channel: CardChannel) -> Pulses:
    if channel.pulses is None:
        raise ValueError(f"{channel.name} has no pulses")
    return channel.pulses


def _rad_per_pulse(channel: CardChannel) -> float:
    return _pulses(channel).rad_per_count * _pulses(channel).decoding


ANALOG: Mapping[str, AnalogKind] = MappingProxyType(
    {
        "voltage": AnalogKind(("V", "N", "m/s2"), _add_voltage),
        "charge_amplifier": AnalogKind(
            ("N", "m/s2"), _add_voltage, needs=(*VOLTS_EACH, "gain"), ac_coupled=True
        ),
        "force_iepe": AnalogKind(
            ("N",), _add_force_iepe, in_volts=False, ac_coupled=True, sheet=_force_sheet
        ),
        "acceleration_iepe": AnalogKind(
            ("m/s2",), _add_acceleration_iepe, in_volts=False, ac_coupled=True, sheet=_acceleration_sheet
        ),
        "marker": AnalogKind(("V",), _add_voltage, noisy=False),
        "tachometer": AnalogKind(("rad/s",), _add_voltage),
    }
)
COUNTERS: Mapping[str, CounterKind] = MappingProxyType(
    {
        "encoder": CounterKind(
            ("rad",),
            _add_encoder,
            ("pulses",),
            "count",
            lambda channel: _pulses(channel).rad_per_count,
            _angle_decoder,
        ),
        "marker": CounterKind(
            ("V",), _add_edges, ("range",), "edge", lambda _: None, lambda channel: MarkPulses(channel.range)
        ),
        "tachometer": CounterKind(
            ("rad/s",),
            _add_frequency,
            ("pulses", "range"),
            "Hz",
            _rad_per_pulse,
            lambda channel: speed(_rad_per_pulse(channel)),
            read="read_many_sample_double",
            dtype=np.float64,
        ),
    }
)
INPUTS: Mapping[str, Mapping[str, Kind]] = MappingProxyType({"ai": ANALOG, "ctr": COUNTERS})


def described(channel: CardChannel) -> Channel:
    """Return what a log keeps of a channel, its stages included."""
    kind = INPUTS.get(channel.input, {}).get(channel.kind)
    stages = (f"{name} {stage.serial}" for name, stage in channel.stages.items() if stage.serial)
    return Channel(
        name=channel.name,
        unit=channel.unit,
        quantity=channel.quantity,
        location=channel.location,
        sensor=" + ".join([channel.sensor or channel.kind, *channel.stages]),
        serial=", ".join(text for text in (channel.serial, *stages) if text),
        scale=None if kind is None else _scale(kind, channel),
        raw_unit="" if kind is None else kind.raw_unit,
    )


def _scale(kind: Kind, channel: CardChannel) -> float | None:
    try:
        return kind.scale(channel)
    except (ZeroDivisionError, ValueError):
        return None  # numbers that cannot be are told when the card is opened
