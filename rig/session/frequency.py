"""Whether the drive has the frequency that the scenario asks for, by its measurement."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, pi, sqrt
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from daq.signals.sine import SineFit, fit_growing, fit_sine
from rig.stream import Block, Record
from rig.twin.alignment import FREQUENCY_TOLERANCE

TOLERANCE = 2e-4
"""Of the frequency: what the source held its drive to during each point of a sweep."""
OFF, UNKNOWN, HELD = "drive.frequency_off", "drive.frequency_unknown", "drive.frequency"
"""Codes of the event that tells the verdict on a record."""
_PER_CYCLE = 64
"""Samples kept of a cycle; enough for the three orders that a distorted drive has."""
_ORDERS = 3
_SURE_CYCLES = 200
"""From the nominal frequency on, a fit of so many cycles finds what is off by up to 0.1 %."""
_PARTS, _PART_CYCLES = 8, 10
ON_THEIR_WAY_S = 0.2
"""Samples that come within it were taken before what has been done just now."""
_TRIM_SHARE, _TRIM_S, _TRIM_CYCLES, _TRIM_ON_CYCLES = 0.75, 0.2, 2.0, 8.0
"""The frequency is measured within three quarters of the settling time, over 8 cycles and at least 0.2 s
where there is room, under 2 cycles not at all."""
_SEEN = 1.0
"""A sine below so many times what is left after its fit is no drive; noise alone shows one of a quarter."""


@runtime_checkable
class Trimmed(Protocol):
    """A motion whose frequency can be corrected while it runs."""

    def trim(self, off: float) -> None:
        """Correct a frequency that was measured to be `off` by that share of the nominal."""


@dataclass(frozen=True, slots=True)
class DriveFrequency:
    """A measured frequency in Hz (nan: no sine to be seen), and how it lies to the `nominal`.

    `off` is the difference as a share of the nominal, `worst` the largest such difference of any part of
    the record, `uncertainty` the standard deviation that noise leaves of `off`.
    """

    nominal: float
    measured: float = nan
    off: float = nan
    worst: float = nan
    uncertainty: float = nan

    @property
    def held(self) -> bool:
        """Whether every part of the record shows the nominal frequency within 2 parts in 10,000."""
        return abs(self.worst) <= TOLERANCE and self.uncertainty <= TOLERANCE / 2

    @property
    def correctable(self) -> bool:
        """Whether it is known, worth a correction, and off by no more than clocks may differ by."""
        return self.known and TOLERANCE / 10 < abs(self.off) < FREQUENCY_TOLERANCE

    @property
    def known(self) -> bool:
        """Whether it is known ten times better than it has to be held."""
        return self.uncertainty < TOLERANCE / 10

    @property
    def code(self) -> str:
        if self.held:
            return HELD
        return OFF if abs(self.worst) > TOLERANCE else UNKNOWN

    def __str__(self) -> str:
        if np.isnan(self.measured):
            return f"no drive is seen whose frequency of {self.nominal:g} Hz could be verified"
        if self.code == UNKNOWN:
            return f"drive too faint or too short to tell {self.nominal:g} Hz to 2 parts in 10,000"
        if abs(self.worst) > max(TOLERANCE, 1.2 * abs(self.off)):
            return f"drive at {self.nominal:g} Hz wanders by {self.worst:+.1e} of it within the record"
        return f"drive at {self.measured:.7g} Hz, {self.off:+.1e} of {self.nominal:g} Hz off"


class DriveMeter:
    """Measures the frequency of a drive whose samples (any unit) come in blocks without holes."""

    def __init__(self, nominal_hz: float, sample_rate: float) -> None:
        self._nominal = nominal_hz
        self._every = max(1, int(sample_rate / (nominal_hz * _PER_CYCLE)))
        self._rate = sample_rate / self._every
        self._left: NDArray[np.floating] = np.empty(0)
        self._means: list[NDArray[np.float64]] = []

    def add(self, values: NDArray[np.floating]) -> None:
        """Take the next samples, shape (n,)."""
        values = np.concatenate((self._left, values))
        whole = len(values) // self._every * self._every
        self._left = values[whole:]
        self._means.append(values[:whole].reshape(-1, self._every).mean(axis=1, dtype=np.float64))

    @property
    def cycles(self) -> float:
        return sum(len(each) for each in self._means) * self._nominal / self._rate

    def result(self) -> DriveFrequency:
        drive = np.concatenate(self._means) if self._means else np.empty(0)
        # what is no number is noise to the fit and makes the frequency less certain
        drive = np.where(np.isfinite(drive), drive, 0.0)
        size = np.abs(drive)
        if len(drive):  # one that starts within the record counts from where it is under way
            drive = drive[int(np.argmax(size > 0.5 * size.max())) :]
        if len(drive) < _PER_CYCLE:
            return DriveFrequency(self._nominal)
        fit = fit_growing(drive, self._rate, self._nominal, _SURE_CYCLES, _ORDERS)
        if fit.amplitude <= _SEEN * fit.residual:
            return DriveFrequency(self._nominal)
        # of the whole and its parts; what noise may do to a short part does not count
        parts = min(_PARTS, int(self.cycles / _PART_CYCLES))
        found = [self._off(fit)]
        for part in np.array_split(drive, parts) if parts > 1 else []:
            part_fit = fit_sine(part, self._rate, fit.frequency, harmonics=_ORDERS)
            noise = 3 * self._uncertainty(part_fit, part)
            off = self._off(part_fit)
            found.append(np.sign(off) * max(abs(off) - noise, 0.0))
        return DriveFrequency(
            self._nominal,
            fit.frequency,
            self._off(fit),
            float(max(found, key=abs)),
            self._uncertainty(fit, drive),
        )

    def _off(self, fit: SineFit) -> float:
        return fit.frequency / self._nominal - 1

    def _uncertainty(self, fit: SineFit, drive: NDArray[np.float64]) -> float:
        """By the Cramer-Rao bound of a sine's frequency in white noise."""
        lasts_s = len(drive) / self._rate
        deviation_hz = sqrt(6 / len(drive)) * fit.residual / (pi * fit.amplitude * lasts_s)
        return deviation_hz / self._nominal


class FrequencyHold:
    """Measures the drive while it settles, so that its frequency can be corrected before the record.

    `channel` is the one that shows it. `take` is called in the acquisition thread, the others by whoever
    waits.
    """

    def __init__(self, channel: str, nominal_hz: float, sample_rate: float) -> None:
        self.channel = channel
        self._nominal_hz, self._rate = nominal_hz, sample_rate
        self._meter: DriveMeter | None = None

    def measured_s(self, settle_s: float) -> float:
        """How long to measure, after what was on its way; 0 where a settling time has no room for it."""
        room_s = _TRIM_SHARE * settle_s - ON_THEIR_WAY_S
        if room_s * self._nominal_hz < _TRIM_CYCLES:
            return 0.0
        return min(room_s, max(_TRIM_S, _TRIM_ON_CYCLES / self._nominal_hz))

    def begin(self) -> None:
        self._meter = DriveMeter(self._nominal_hz, self._rate)

    def take(self, values: NDArray[np.floating]) -> None:
        if (meter := self._meter) is not None:
            meter.add(values)

    def end(self) -> DriveFrequency:
        meter, self._meter = self._meter, None
        return (meter or DriveMeter(self._nominal_hz, self._rate)).result()


class FrequencyCheck:
    """Watches one measured channel of a stream; `result` is the verdict on its record."""

    def __init__(self, channel: str, nominal_hz: float) -> None:
        self._channel, self._nominal_hz = channel, nominal_hz
        self._meter: DriveMeter | None = None
        self._end = 0

    def __call__(self, record: Record) -> None:
        match record:
            case Block("measured", samples) if samples.channel == self._channel:
                if self._meter is None or samples.first_sample != self._end:  # it begins anew after a hole
                    self._meter = DriveMeter(self._nominal_hz, samples.sample_rate)
                self._end = samples.end_sample
                self._meter.add(samples.values)

    def result(self) -> DriveFrequency:
        return self._meter.result() if self._meter else DriveFrequency(self._nominal_hz)
