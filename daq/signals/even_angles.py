"""Samples taken evenly in time turned into samples at even angles, whole or block by block."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.errors import UnphysicalParameter
from daq.signals.interpolation import LOBES, interpolate
from daq.signals.segments import usable

_LONGEST_STRETCH = 32.0
"""Below 1/32 of the input's rate the filter against aliases widens no further, so that memory is bounded."""

_LARGEST_STEP = 0.5
"""Turns from one sample to the next beyond which an angle cannot be told from another."""

_HISTORY = int(LOBES * _LONGEST_STRETCH) + 2


class EvenAngles(NamedTuple):
    """Values, shape (k,) or (channels, k), of which number i belongs to turn (first + i) / points."""

    first: int
    values: NDArray[np.float64]


class AngleSampler:
    """Resamples blocks of any size at `points` even angles a turn; the cuts leave no trace.

    What lies above 0.44 `points` orders (or 0.44 of the sampling rate) is filtered out; where angles come
    more than 32 samples apart it comes back as an alias. From sample to sample the angle is a straight line.
    An angle counts the first time it is passed. Near a sample that is flagged or not finite or has no turn,
    and near the start of the record, values are NaN. They come out late by the length of the filter, 24
    angles or more.
    """

    def __init__(self, points: int) -> None:
        if points < 1:
            raise UnphysicalParameter("angular resampling", "points a turn", points, "at least 1")
        self._points = points
        self._turn: float | None = None  # the farthest so far
        self._index = 0  # of the next even angle that comes out
        self._end = 0  # samples taken
        self._kept = np.empty((0, _HISTORY))  # the newest samples
        # Of the angles that were passed but are not out yet: the sample before, and how far after it.
        self._base = np.empty(0, dtype=np.int64)
        self._fraction = np.empty(0)

    def add(
        self,
        values: NDArray[np.floating],
        turns: NDArray[np.floating],
        flagged: NDArray[np.bool_] | None = None,
    ) -> EvenAngles:
        """Take the next samples, shape (n,) or (channels, n), with their turns, shape (n,).

        `flagged`, shape (n,) or that of `values`, is True for samples that must not count. Raises
        UnphysicalParameter where the angle leaps by more than half a turn.
        """
        news = usable(values, flagged)
        news[:, np.isnan(turns)] = np.nan
        before = self._kept if self._end else np.full((len(news), _HISTORY), np.nan)
        self._kept = np.concatenate((before, news), axis=1)
        self._take_turns(np.asarray(turns, dtype=np.float64))
        found = self._ready()
        return EvenAngles(self._index - found.shape[1], found[0] if np.ndim(values) == 1 else found)

    def _take_turns(self, turns: NDArray[np.float64]) -> None:
        start, self._end = self._end, self._end + len(turns)
        if self._turn is None:
            known = turns[np.isfinite(turns)]
            if not len(known):
                return
            self._turn = float(known[0])
            self._index = int(self._passed(self._turn - 2 / self._points, self._turn)[-1]) + 1
        way = np.fmax.accumulate(np.concatenate(([self._turn], turns)))
        leap = float(np.max(np.diff(way), initial=0.0))
        if leap > _LARGEST_STEP:
            raise UnphysicalParameter(
                "angular resampling", "turns from sample to sample", leap, "at most 0.5"
            )
        target = self._passed(self._turn, float(way[-1])) / self._points
        after = np.searchsorted(way, target)
        fraction = (target - way[after - 1]) / (way[after] - way[after - 1])
        self._base = np.concatenate((self._base, start + after.astype(np.int64) - 2))
        self._fraction = np.concatenate((self._fraction, fraction))
        self._turn = float(way[-1])

    def _passed(self, start: float, end: float) -> NDArray[np.int64]:
        """Even angles after turn `start` up to turn `end`."""
        index = np.arange(int(start * self._points) - 2, int(end * self._points) + 3, dtype=np.int64)
        turn = index / self._points
        return index[(turn > start) & (turn <= end)]

    def _ready(self) -> NDArray[np.float64]:
        """Values at the angles whose filter reaches no further than the newest sample."""
        base, fraction = self._base, self._fraction
        spacing = np.full(len(base), np.inf)
        # No angle has followed the last one yet: it waits until the longest filter fits behind it.
        spacing[:-1] = np.diff(base) + np.diff(fraction)
        stretch = np.clip(spacing, 1.0, _LONGEST_STRETCH)
        late = base + 1 + np.ceil(LOBES * stretch).astype(np.int64) >= self._end
        count = int(np.argmax(late)) if late.any() else len(late)
        first = self._end - self._kept.shape[1]
        found = interpolate(self._kept, base[:count] - first, fraction[:count], stretch[:count])
        self._base, self._fraction = base[count:], fraction[count:]
        self._index += count
        needed = int(min(self._base[0], self._end)) if len(self._base) else self._end
        self._kept = self._kept[:, max(needed - _HISTORY - first, 0) :].copy()
        return found
