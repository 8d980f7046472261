"""Crank speed in rpm at an even rate, from an encoder's angle or from the marks of a marker."""

from __future__ import annotations

from math import tau

import numpy as np
from numpy.typing import NDArray

from daq.angle.cycles import MarkerCycles

Array = NDArray[np.float64]

SPEED_HZ = 50.0
"""Even rate of the speed: at 200 rpm 15 values a revolution, each over 273 counts of an encoder with 4096."""

Run = tuple[int, Array]
"""Index of the first of some consecutive values, and the values in rpm."""


def samples_per_speed(sample_rate: float) -> int:
    """How many samples a speed is of: whole ones, so that the rate may be not quite 50 Hz."""
    return max(round(sample_rate / SPEED_HZ), 2)


class AngleSpeed:
    """Speed from crank angle in rad: the slope of the straight line through each `every` samples.

    Value k is of samples k `every` to (k + 1) `every`. Through all of them, so that the steps of a counter
    weigh little. Values whose samples are not all there are left out.
    """

    def __init__(self, sample_rate: float, every: int) -> None:
        distance = np.arange(every) - (every - 1) / 2
        self._weights = distance / np.sum(distance**2) * sample_rate * 60.0 / tau
        self._every = every
        self._kept = np.empty(0)
        self._next = 0

    def add(self, first_sample: int, values: NDArray[np.floating]) -> list[Run]:
        """Take the next angles, shape (n,); return the speeds that they complete."""
        angles = np.asarray(values, np.float64)
        if first_sample != self._next:
            start = -(-first_sample // self._every) * self._every
            angles, self._kept = angles[start - first_sample :], np.empty(0)
            first_sample = start
        kept = np.concatenate((self._kept, angles))
        begin = first_sample - len(self._kept)
        count = len(kept) // self._every
        self._kept = kept[count * self._every :].copy()
        self._next = begin + len(kept)
        # A sum of copies that lie in memory alike: equal to the bit however blocks cut them.
        parts = (kept[at * self._every : (at + 1) * self._every].copy() for at in range(count))
        speeds = np.array([float(np.sum((part - part[0]) * self._weights)) for part in parts])
        return [(begin // self._every, speeds)] if count else []


class MarkerSpeed:
    """Speed from marks: that of the revolution in which the middle of samples k `every` ... lies."""

    def __init__(self, cycles: MarkerCycles, sample_rate: float, every: int) -> None:
        self._cycles, self._rate, self._every = cycles, sample_rate, every
        self._index = 0

    def take(self, end_sample: int) -> list[Run]:
        """Speeds that are certain by now of the samples before `end_sample`; NaN where none is known."""
        until = min(self._cycles.begins.until, end_sample)
        first, speeds = self._index, []
        while (self._index + 0.5) * self._every < until:
            samples = self._cycles.samples_per_turn((self._index + 0.5) * self._every)
            speeds.append(60.0 * self._rate / samples)
            self._index += 1
        return [(first, np.array(speeds))] if speeds else []
