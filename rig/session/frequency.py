"""Whether the drive has the frequency that the scenario asks for, by its measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, hypot, nan, pi, sqrt
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from daq.signals.sine import SineFit, fit_growing, fit_sine, waves_of
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
_LONG_CYCLES = 400
"""Of a longer record its phase is kept alone, each two cycles, and of more of them as it goes on."""
_TRACKED_CYCLES, _MOST_PHASES = 2, 4096
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


class _Thinned:
    """Some 64 means a cycle of samples that come in blocks; what is no number is 0.

    Noise to a fit, it makes the frequency less certain.
    """

    def __init__(self, nominal_hz: float, sample_rate: float) -> None:
        self._every = max(1, int(sample_rate / (nominal_hz * _PER_CYCLE)))
        self.rate = sample_rate / self._every
        self._left: NDArray[np.floating] = np.empty(0)

    def add(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """The means that the next samples, shape (n,), complete."""
        values = np.concatenate((self._left, values))
        whole = len(values) // self._every * self._every
        self._left = values[whole:]
        means = values[:whole].reshape(-1, self._every).mean(axis=1, dtype=np.float64)
        return np.where(np.isfinite(means), means, 0.0)


@dataclass(frozen=True, slots=True)
class _Part:
    """Of a record or a part of it: by how much its frequency is off, as a share; amplitude, rms beside it."""

    off: float
    amplitude: float
    residual: float
    samples: int

    def uncertainty(self, nominal_hz: float, rate: float) -> float:
        """Of `off`, by the Cramer-Rao bound of a sine's frequency in white noise."""
        lasts_s = self.samples / rate
        deviation_hz = sqrt(6 / self.samples) * self.residual / (pi * self.amplitude * lasts_s)
        return deviation_hz / nominal_hz


def _found(nominal_hz: float, rate: float, whole: _Part, parts: Sequence[_Part]) -> DriveFrequency:
    """Of the whole and its parts; what noise may do to a short part does not count."""
    if whole.amplitude <= _SEEN * whole.residual:
        return DriveFrequency(nominal_hz)
    found = [whole.off]
    for part in parts:
        noise = 3 * part.uncertainty(nominal_hz, rate)
        found.append(float(np.sign(part.off)) * max(abs(part.off) - noise, 0.0))
    uncertainty = whole.uncertainty(nominal_hz, rate)
    return DriveFrequency(
        nominal_hz, nominal_hz * (1 + whole.off), whole.off, max(found, key=abs), uncertainty
    )


class DriveMeter:
    """Measures the frequency of a drive whose samples (any unit) come in blocks without holes.

    All of them are fitted at once: for a record that is not long.
    """

    def __init__(self, nominal_hz: float, sample_rate: float) -> None:
        self._nominal, self._thinned = nominal_hz, _Thinned(nominal_hz, sample_rate)
        self._means: list[NDArray[np.float64]] = []

    def add(self, values: NDArray[np.floating]) -> None:
        """Take the next samples, shape (n,)."""
        self._means.append(self._thinned.add(values))

    @property
    def cycles(self) -> float:
        return sum(len(each) for each in self._means) * self._nominal / self._thinned.rate

    def result(self) -> DriveFrequency:
        drive = np.concatenate(self._means) if self._means else np.empty(0)
        size = np.abs(drive)
        if len(drive):  # one that starts within the record counts from where it is under way
            drive = drive[int(np.argmax(size > 0.5 * size.max())) :]
        if len(drive) < _PER_CYCLE:
            return DriveFrequency(self._nominal)
        rate = self._thinned.rate
        fit = fit_growing(drive, rate, self._nominal, _SURE_CYCLES, _ORDERS)
        count = min(_PARTS, int(self.cycles / _PART_CYCLES))
        parts = np.array_split(drive, count) if count > 1 and fit.amplitude > _SEEN * fit.residual else []
        fits = [fit_sine(part, rate, fit.frequency, harmonics=_ORDERS) for part in parts]
        told = [self._told(each, len(part)) for each, part in zip(fits, parts, strict=True)]
        return _found(self._nominal, rate, self._told(fit, len(drive)), told)

    def _told(self, fit: SineFit, samples: int) -> _Part:
        return _Part(fit.frequency / self._nominal - 1, fit.amplitude, fit.residual, samples)


class _PhaseTrack:
    """Measures the frequency of a record of any length by its phase, in as much memory as ever.

    The phase, relative to the nominal frequency, is fitted to every two cycles by themselves, so that it is
    followed up to a quarter off; once there are many, two and two become one.
    """

    def __init__(self, nominal_hz: float, sample_rate: float) -> None:
        self._nominal, self._thinned = nominal_hz, _Thinned(nominal_hz, sample_rate)
        rate = self._thinned.rate
        self._length = round(_TRACKED_CYCLES * rate / nominal_hz)
        step = 2 * pi * nominal_hz / rate
        middle = (self._length - 1) / 2
        angle = np.asarray(step * (np.arange(self._length) - middle), dtype=np.float64)
        self._waves = waves_of(angle, np.arange(1, _ORDERS + 1))
        self._solved, self._advance = np.linalg.pinv(self._waves), step * self._length
        self._left = np.empty(0)
        self._count, self._phase = 0, 0.0
        self._waiting: list[NDArray[np.float64]] = []
        self._rows: list[NDArray[np.float64]] = []  # phase, amplitude, mean square beside it
        self._together = 1

    def add(self, values: NDArray[np.floating]) -> None:
        """Take the next samples, shape (n,)."""
        means = np.concatenate((self._left, self._thinned.add(values)))
        whole = len(means) // self._length * self._length
        self._left = means[whole:]
        for y in means[:whole].reshape(-1, self._length):
            parts = self._solved @ y
            beside = y - self._waves @ parts
            phase = atan2(parts[2], parts[1]) - self._count * self._advance
            self._phase = phase + 2 * pi * round((self._phase - phase) / (2 * pi))
            self._count += 1
            self._note(np.array([self._phase, hypot(parts[1], parts[2]), beside @ beside / len(y)]))

    def _note(self, row: NDArray[np.float64]) -> None:
        self._waiting.append(row)
        if len(self._waiting) == self._together:
            self._rows.append(np.mean(self._waiting, axis=0))
            self._waiting.clear()
        if len(self._rows) == _MOST_PHASES:
            self._rows = list(np.mean(np.reshape(self._rows, (-1, 2, 3)), axis=1))
            self._together *= 2

    def result(self) -> DriveFrequency:
        rows = np.array(self._rows)
        under_way = int(np.argmax(rows[:, 1] > 0.5 * rows[:, 1].max()))
        rows = rows[under_way + (under_way > 0) :]
        if len(rows) < 2 * _PARTS:  # as loud at its end alone: nothing is said of what came before
            return DriveFrequency(self._nominal)
        parts = [self._told(part) for part in np.array_split(rows, _PARTS)]
        return _found(self._nominal, self._thinned.rate, self._told(rows), parts)

    def _told(self, rows: NDArray[np.float64]) -> _Part:
        samples = self._length * self._together
        seconds = samples / self._thinned.rate * np.arange(len(rows))
        slope = float(np.polyfit(seconds, rows[:, 0], 1)[0])
        amplitude, square = rows[:, 1:].mean(axis=0)
        return _Part(slope / (2 * pi * self._nominal), amplitude, sqrt(square), samples * len(rows))


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
        self._track: _PhaseTrack | None = None
        self._end = 0

    def __call__(self, record: Record) -> None:
        match record:
            case Block("measured", samples) if samples.channel == self._channel:
                if self._track is None or samples.first_sample != self._end:  # it begins anew after a hole
                    self._meter = DriveMeter(self._nominal_hz, samples.sample_rate)
                    self._track = _PhaseTrack(self._nominal_hz, samples.sample_rate)
                self._end = samples.end_sample
                self._track.add(samples.values)
                if self._meter is not None:
                    self._meter.add(samples.values)
                    self._meter = self._meter if self._meter.cycles <= _LONG_CYCLES else None

    def result(self) -> DriveFrequency:
        measured = self._meter or self._track
        return measured.result() if measured else DriveFrequency(self._nominal_hz)
