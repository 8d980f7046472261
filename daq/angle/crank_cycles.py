"""Revolutions of a crank, from its angle or from a mark once a revolution."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import ceil, nan, tau

import numpy as np
from numpy.typing import NDArray

from daq.angle.begins import END, KnownBegins
from daq.angle.marker import MarkTracker

Array = NDArray[np.float64]

KEPT_S = 8.0
"""Angles that are kept for impacts that end, with all their bounces, after they began."""
GIVE_UP_S = 6.0
"""How long the next mark is waited for: three revolutions at 40 rpm must pass before a marker is believed."""
_MOST_MARKS = 4096
_MOST_TURNS = 2.0**52


class AngleCycles:
    """Revolutions of an unwrapped crank angle in rad; one that goes back stays in the revolution."""

    def __init__(self, sample_rate: float) -> None:
        self.begins = KnownBegins()
        self._kept = round(KEPT_S * sample_rate)
        self._recent: deque[tuple[int, Array]] = deque()
        self._furthest = -np.inf

    def add(self, first_sample: int, values: NDArray[np.floating], usable: bool = True) -> None:
        """Take the next angles, shape (n,)."""
        if not len(values):
            return
        turns = np.asarray(values, np.float64) / tau
        turns[~(np.abs(turns) < _MOST_TURNS)] = np.nan
        self._recent.append((first_sample, turns))
        while self._recent[0][0] < first_sample - self._kept:
            self._recent.popleft()
        way = np.fmax.accumulate(np.concatenate(([self._furthest], turns)))
        number = np.floor(way)
        for index in np.flatnonzero(number[1:] > number[:-1]).tolist():
            if np.isfinite(number[index]) or way[index + 1] == number[index + 1]:
                self.begins.note(first_sample + index, int(number[index + 1]), usable)
        self._furthest = float(way[-1])
        self.begins.until = first_sample + len(values)

    def finish(self) -> None:
        """No more angles will come."""
        self.begins.until = END

    def turns_at(self, sample: int) -> float:
        """Revolutions that the counter shows at a sample of the last seconds."""
        for first, turns in reversed(self._recent):
            if first <= sample < first + len(turns):
                return float(turns[sample - first])
        return nan


class MarkerCycles:
    """Revolutions between the marks of a marker in V; a shaft that stops has none until it turns again.

    The angle is taken to grow evenly from mark to mark.
    """

    def __init__(self, sample_rate: float) -> None:
        self.begins = KnownBegins()
        self._give_up = round(GIVE_UP_S * sample_rate)
        self._tracker = MarkTracker()
        self._base = self._next = 0
        self._number_base = self._number = -1
        self._positions: list[float] = []
        self._turns: list[int] = []
        self._restarts: set[int] = set()

    def add(self, first_sample: int, values: NDArray[np.floating], usable: bool = True) -> None:
        """Take the next samples of the marker, shape (n,)."""
        if first_sample != self._next:
            self._tracker, self._base, self._number_base = MarkTracker(), first_sample, self._number
        marks, _ = self._tracker.track(values)
        rows = zip(marks.position.tolist(), marks.turn.tolist(), marks.restart.tolist(), strict=True)
        for position, turn, restart in rows:
            self._note(self._base + position, self._number_base + 1 + turn, restart)
        self._next = first_sample + len(values)
        self.begins.until = max(self.begins.until, self._next - self._give_up)

    def finish(self) -> None:
        """No more samples will come."""
        self.begins.until = END

    def turns_at(self, sample: int) -> float:
        """Revolutions since the first mark."""
        at = self._turn_of(sample)
        if at is None:
            return nan
        start, end = self._positions[at], self._positions[at + 1]
        return self._turns[at] + (sample - start) / (end - start)

    def samples_per_turn(self, sample: float) -> float:
        """How long the revolution takes in which a sample lies, in samples; NaN if it is not known."""
        at = self._turn_of(sample)
        return nan if at is None else self._positions[at + 1] - self._positions[at]

    def _note(self, position: float, number: int, restart: bool) -> None:
        self._positions.append(position)
        self._turns.append(number)
        self._number = number
        if restart:
            self._restarts.add(number)
        sample = ceil(position)
        self.begins.note(sample, number, not restart)
        self.begins.until = max(self.begins.until, sample)
        if len(self._positions) > 2 * _MOST_MARKS:
            del self._positions[:_MOST_MARKS], self._turns[:_MOST_MARKS]
            self._restarts = {each for each in self._restarts if each >= self._turns[0]}

    def _turn_of(self, sample: float) -> int | None:
        at = bisect_right(self._positions, sample) - 1
        if not 0 <= at < len(self._positions) - 1 or self._turns[at + 1] in self._restarts:
            return None
        return at if self._positions[at + 1] - self._positions[at] <= self._give_up else None
