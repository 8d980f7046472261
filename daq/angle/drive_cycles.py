"""Cycles of a sine drive of nearly constant frequency, followed through a run of any length."""

from __future__ import annotations

from math import ceil, tau

import numpy as np
from numpy.typing import NDArray

from daq.angle.begins import END, KnownBegins
from daq.signals.sine import fit_sine

_WINDOW_S = 1.0
_POINTS_A_CYCLE = 16
_WORST_RESIDUAL = 0.5
"""Rms, as a share of the amplitude: a drive with strong harmonics stays below 0.2, noise alone does not."""


class DriveCycles:
    """A sine of given `frequency` (Hz) and `phase` (rad, at sample 0) whose phase is renewed as it goes.

    Each second of the drive (whole cycles) is fitted at that frequency, and the phase found holds for the
    second but one after it, so that begins are known ahead of every channel: a clock that is off by some ppm
    adds up to nothing. A second that shows no such sine, or has samples missing, leaves the phase as it is.
    """

    def __init__(self, sample_rate: float, frequency: float, phase: float) -> None:
        self.begins = KnownBegins()
        self._rate, self._frequency, self._step = sample_rate, frequency, frequency / sample_rate
        cycles = max(round(_WINDOW_S * frequency), 1)
        self._window = round(cycles * sample_rate / frequency)
        self._mean_of = max(int(sample_rate / (frequency * _POINTS_A_CYCLE)), 1)
        self._parts: list[NDArray[np.floating]] = []
        self._sound = True
        self._next = 0
        self._offsets: list[float] = []
        self._number = ceil(phase / tau)
        self._open(phase / tau)

    def add(self, first_sample: int, values: NDArray[np.floating], usable: bool = True) -> None:
        """Take the next samples of the drive, shape (n,); what lies between two calls is missing."""
        while self._next < first_sample:
            self._pass(min(first_sample, self._end) - self._next, None)
        while len(values):
            part = values[: self._end - self._next]
            values = values[len(part) :]
            self._pass(len(part), part if usable else None)

    def finish(self) -> None:
        """No more samples will come: the last phase holds for those of other channels."""
        self.begins.until = END

    def turns_at(self, sample: int) -> float:
        """Cycles since the rising zero that lies before sample 0."""
        window = min(sample // self._window, len(self._offsets) - 1)
        return sample * self._step + self._offsets[window]

    @property
    def _end(self) -> int:
        """End of the window that is being collected."""
        return (len(self._offsets) - 1) * self._window

    def _pass(self, count: int, part: NDArray[np.floating] | None) -> None:
        self._next += count
        if part is None:
            self._sound = False
        else:
            self._parts.append(part)
        if self._next == self._end:
            offset = self._offsets[-1]
            self._open(offset + self._late(offset) if self._sound else offset)
            self._parts, self._sound = [], True

    def _open(self, offset: float) -> None:
        """Let the next window begin, with every begin in it; the first opens the one that it was measured in
        as well."""
        first = not self._offsets
        self._offsets += [offset, offset] if first else [offset]
        start = 0 if first else (len(self._offsets) - 1) * self._window
        end = len(self._offsets) * self._window
        while (sample := max(self._begin_of(self._number, offset), start)) < end:
            self.begins.note(sample, self._number)
            self._number += 1
        self.begins.until = end

    def _begin_of(self, number: int, offset: float) -> int:
        """First sample whose turns are `number` or more, by the same rounding as `turns_at`."""
        sample = ceil((number - offset) / self._step)
        while sample * self._step + offset < number:
            sample += 1
        while (sample - 1) * self._step + offset >= number:
            sample -= 1
        return sample

    def _late(self, offset: float) -> float:
        """What the window's drive is ahead of `offset`, in turns; 0 where it shows no sine."""
        values = np.concatenate(self._parts).astype(np.float64)
        count = len(values) // self._mean_of * self._mean_of
        points = values[:count].reshape(-1, self._mean_of).mean(axis=1)
        if not np.isfinite(points).all():
            return 0.0
        fit = fit_sine(points, self._rate / self._mean_of, self._frequency, hold_frequency=True)
        if not 0.0 < fit.residual < _WORST_RESIDUAL * fit.amplitude:
            return 0.0
        first = self._end - self._window + (self._mean_of - 1) / 2
        late = fit.phase / tau - (first * self._step + offset)
        return float((late + 0.5) % 1.0 - 0.5)
