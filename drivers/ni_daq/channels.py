"""What hangs on the inputs of a card, and how each kind of sensor is declared to DAQmx."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from typing import Any

from nidaqmx.constants import (
    AccelSensitivityUnits,
    AccelUnits,
    ExcitationSource,
    ForceIEPESensorSensitivityUnits,
    ForceUnits,
)

from daq import Channel
from daq.errors import Problem

STANDARD_GRAVITY = 9.80665  # m/s2, 3rd CGPM 1901; DAQmx takes accelerometer sensitivities per g
LATER_KINDS = ("encoder", "marker", "tachometer")


@dataclass(frozen=True, slots=True)
class CardChannel:
    """One input: which sensor is on it, and its calibration.

    `sensitivity` is in V per `unit`, for a charge amplifier in C per `unit` with `gain` in V/C. `range` is
    the largest magnitude to be measured, in `unit`. `excitation_a` is the supply of an IEPE sensor in A; an
    NI 9234 has 2 mA and nothing else.
    """

    name: str
    physical: str
    kind: str
    sensitivity: float
    range: float
    gain: float | None = None
    unit: str = "V"
    quantity: str = ""
    location: str = ""
    sensor: str = ""
    serial: str = ""
    calibrated: date | None = None
    valid_until: date | None = None
    excitation_a: float = 0.002

    @property
    def volts_per_unit(self) -> float:
        """Volts at the input for one `unit`."""
        return self.sensitivity * (1.0 if self.gain is None else self.gain)

    def describe(self) -> Channel:
        """Return what a log keeps of this channel."""
        in_volts = self.kind in KINDS and KINDS[self.kind].in_volts
        return Channel(
            name=self.name,
            unit=self.unit,
            quantity=self.quantity,
            location=self.location,
            sensor=self.sensor or self.kind,
            serial=self.serial,
            scale=1.0 / self.volts_per_unit if in_volts else None,
            raw_unit="V" if in_volts else "",
        )


@dataclass(frozen=True, slots=True)
class CardSettings:
    """A card with its channels. `grpc` is `host:port` of a device server, None for this machine's driver.

    `sample_rate_hz` must be one that the device has; `buffer_s` is how long the driver keeps samples that
    nobody has read, in s.
    """

    grpc: str | None
    sample_rate_hz: float
    buffer_s: float
    channels: tuple[CardChannel, ...]
    name: str = "DAQ card"


@dataclass(frozen=True, slots=True)
class Kind:
    """How a kind of sensor is added to a task; with `in_volts` DAQmx delivers volts, else the unit itself."""

    in_volts: bool
    units: tuple[str, ...]
    needs_gain: bool
    add: Callable[[Any, CardChannel], None]


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


KINDS = {
    "voltage": Kind(in_volts=True, units=("V", "N", "m/s2"), needs_gain=False, add=_add_voltage),
    "charge_amplifier": Kind(in_volts=True, units=("N", "m/s2"), needs_gain=True, add=_add_voltage),
    "force_iepe": Kind(in_volts=False, units=("N",), needs_gain=False, add=_add_force_iepe),
    "acceleration_iepe": Kind(in_volts=False, units=("m/s2",), needs_gain=False, add=_add_acceleration_iepe),
}


def problems(settings: CardSettings) -> list[Problem]:
    """Return everything that is wrong with the settings of a card by themselves."""
    found: list[Problem] = []
    if not settings.channels:
        found.append(Problem("channels", "none", "at least one"))
    for key in ("sample_rate_hz", "buffer_s"):
        if not _positive(getattr(settings, key)):
            found.append(Problem(key, repr(getattr(settings, key)), "above 0"))
    for field in ("name", "physical"):
        counts = Counter(getattr(channel, field) for channel in settings.channels)
        found += [Problem(f"channels.{field}", text, "only once") for text, n in counts.items() if n > 1]
    for channel in settings.channels:
        found += _channel_problems(channel)
    return found


def _channel_problems(channel: CardChannel) -> list[Problem]:
    key = f"channels[{channel.name}]"
    kind = KINDS.get(channel.kind)
    if kind is None:
        later = "not supported yet; " if channel.kind in LATER_KINDS else ""
        return [Problem(f"{key}.kind", channel.kind, f"{later}one of {', '.join(KINDS)}")]
    found = [
        Problem(f"{key}.{field}", repr(getattr(channel, field)), "above 0")
        for field in ("sensitivity", "range", "excitation_a")
        if not _positive(getattr(channel, field))
    ]
    if channel.unit not in kind.units:
        found.append(Problem(f"{key}.unit", channel.unit, f"one of {', '.join(kind.units)}"))
    if kind.needs_gain and not _positive(channel.gain or 0.0):
        found.append(Problem(f"{key}.gain", repr(channel.gain), "above 0, in V/C"))
    if not kind.needs_gain and channel.gain is not None:
        found.append(Problem(f"{key}.gain", repr(channel.gain), "only for a charge_amplifier"))
    return found


def _positive(value: float) -> bool:
    return math.isfinite(value) and value > 0.0
