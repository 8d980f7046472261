"""Cuts a record into the cycles of its drive, or of its crank."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.channel_table import Role

Array = NDArray[np.floating]
_LEAST_SHARE = 0.5
"""Of its power, that a signal has at the frequency of the sine that it is taken for."""
_SAFE_CYCLES = 300.0
"""In which a drive 0.1 % off its frequency is not yet a quarter of a turn away."""
_TIMES = 6
"""Of looking up the drift, until a start lies where it says."""


@dataclass(frozen=True, slots=True)
class Cycles:
    """Mean `frequency` in Hz and `phase` in rad at the first sample of a record of `rate` Hz.

    `drift` (2, n) has samples and by how many rad the cycles are ahead of that mean there.
    """

    frequency: float
    phase: float
    rate: float
    drift: Array = field(default_factory=lambda: np.zeros((2, 1)), compare=False)

    @property
    def length(self) -> int:
        """Whole samples in a cycle."""
        return int(self.rate / self.frequency)

    def starts(self, samples: int) -> NDArray[np.intp]:
        """First sample of each cycle that lies, with half of the next one, in so many `samples`."""
        period = self.rate / self.frequency
        first = -((self.phase / (2 * np.pi)) % 1.0) * period
        more = int(np.ceil(np.abs(self.drift[1]).max() / (2 * np.pi)))
        at = steady = first + period * np.arange(-more, int(samples / period) + 2 + more)
        for _ in range(_TIMES if self.drift[1].any() else 0):
            at = steady - period / (2 * np.pi) * np.interp(at, *self.drift)
        starts = np.round(at).astype(np.intp)
        return starts[(starts >= 0) & (starts + self.length + self.length // 2 <= samples)]

    def phases(self, samples: int) -> NDArray[np.float64]:
        """Phase in rad at each of so many `samples`, not wrapped, shape (samples,)."""
        at = np.arange(samples)
        mean = self.phase + 2 * np.pi * self.frequency / self.rate * at
        return np.asarray(mean + np.interp(at, *self.drift) if self.drift[1].any() else mean)


def sine_cycles(values: Array, rate: float, frequency: float) -> Cycles:
    """Follow a sine of nearly `frequency` Hz: its phases in two halves of the record tell how near.

    Harmonics of it do not matter, since whole periods under a Hann window see none of them. Raises ValueError
    where there is no such sine.
    """
    count = min(len(values), int(_SAFE_CYCLES * rate / frequency))
    while True:
        found = _fitted_sine(values[:count], rate, frequency)
        if count == len(values):
            return found
        frequency, count = found.frequency, min(len(values), 2 * count)


def turning(step: float, count: int) -> NDArray[np.complex128]:
    """exp(i `step` k) for k from 0 on, shape (count,), by products."""
    wide = 512
    coarse = np.exp(1j * step * wide * np.arange(-(-count // wide)))
    return np.asarray(np.outer(coarse, np.exp(1j * step * np.arange(wide))).ravel()[:count])


@lru_cache(maxsize=8)
def _hann(count: int) -> Array:
    return np.hanning(count)


def _fitted_sine(values: Array, rate: float, frequency: float) -> Cycles:
    first = drift = 0.0
    for _ in range(2):
        count = int(int(len(values) / 2 * frequency / rate) * rate / frequency)
        window = _hann(count)
        turn = window * turning(-2 * np.pi * frequency / rate, count)
        moved = np.exp(-2j * np.pi * frequency / rate * count)
        level = float(np.mean(values))
        first = float(np.angle(np.sum((values[:count] - level) * turn)))
        second = float(np.angle(np.sum((values[count : 2 * count] - level) * turn) * moved))
        drift = (second - first + np.pi) % (2 * np.pi) - np.pi
        frequency += drift * rate / (2 * np.pi * count)
    power = float(np.var(values[:count]))
    if power <= 0.0:
        raise ValueError("no sine of that frequency")
    share = 2 * abs(np.sum((values[:count] - level) * turn)) ** 2 / window.sum() ** 2 / power
    if not share > _LEAST_SHARE:
        raise ValueError("no sine of that frequency")
    return Cycles(frequency, (first - drift / 2 + np.pi / 2) % (2 * np.pi), rate)


def angle_cycles(values: Array, rate: float, _: float) -> Cycles:
    """Follow an unwrapped crank angle (rad), its means over one turn: it may swing in a turn, and drift."""
    samples = np.arange(len(values))
    centre = float(np.mean(samples))
    angle = np.asarray(values, dtype=np.float64)
    slope = float(np.dot(samples - centre, angle) / np.sum((samples - centre) ** 2))
    phase = float(np.mean(angle)) - slope * centre
    mean = Cycles(slope * rate / (2 * np.pi), phase, rate)
    turn = round(2 * np.pi / slope) if slope > 0 else 0
    if not 1 < turn <= len(angle) // 2:
        return mean
    added = np.concatenate([[0.0], np.cumsum(angle - mean.phases(len(angle)))])
    first = np.arange(0, len(angle) - turn + 1, max(1, turn // 2))
    ahead = (added[first + turn] - added[first]) / turn
    return replace(mean, drift=np.array([first + (turn - 1) / 2, ahead]))


def mark_cycles(values: Array, rate: float, frequency: float) -> Cycles:
    """Follow a once-per-revolution mark that rises at the start of every cycle; ValueError without two.

    A mark that is missing is stepped over, by the period of nearly `frequency` Hz.
    """
    level = (float(np.min(values)) + float(np.max(values))) / 2
    rises = np.flatnonzero((values[:-1] < level) & (values[1:] >= level))
    share = (level - values[rises]) / (values[rises + 1] - values[rises])
    at = rises + share
    if len(at) < 2:
        raise ValueError("no marks")
    turns = np.concatenate([[0.0], np.cumsum(np.round(np.diff(at) * frequency / rate))])
    slope, start = np.polyfit(turns, at, 1)
    ahead = 2 * np.pi * (turns - (at - start) / slope)
    return Cycles(rate / float(slope), float(-start / slope * 2 * np.pi), rate, np.array([at, ahead]))


Follow: TypeAlias = Callable[[Array, float, float], Cycles]
"""Finds the cycles in samples of some rate (Hz), whose frequency is nearly so many Hz."""
FOLLOWS: Final[Mapping[Role, Follow]] = {
    Role.ANGLE: angle_cycles,
    Role.MARKER: mark_cycles,
    Role.DRIVE: sine_cycles,
}
"""By what a channel is to the rig; those that show a drift best first."""
