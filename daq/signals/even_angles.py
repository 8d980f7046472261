"""Turns of samples, and samples taken evenly in time turned into samples at even angles, whole or in blocks.

A turn is one cycle of the drive from the rising zero of its sine, or one revolution from crank angle 0. All
cyclic functions (averages, resampling, orders) take the turns of their samples: float64, unwrapped, one a
sample, on the same clock. The whole part is the number of the cycle, the rest the phase in it.

Between samples: a sinc under a Kaiser window, stretched where the output is the coarser grid. Gain 1 to 1e-4
up to 0.44 of the lower of the two rates, images and aliases below 1e-4 from 0.56 on. Crochiere and Rabiner,
Multirate Digital Signal Processing, chapter 2; Kaiser's formulas for 80 dB.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from daq.errors import UnphysicalParameter
from daq.signals.spectrum import usable

_CUBIC = 3
_LOBES = 24
"""Zeros of the kernel on each side: how many steps of the coarser grid it reaches."""
_STOP_BAND_DB = 80.0
_BETA = 0.1102 * (_STOP_BAND_DB - 8.7)
_STEPS = 1024
"""Entries of the table from zero to zero: between them a straight line is right to 4e-7."""
_WINDOW = np.kaiser(2 * _LOBES * _STEPS + 1, _BETA)[_LOBES * _STEPS :]
_KERNEL = np.append(np.sinc(np.arange(_LOBES * _STEPS) / _STEPS) * _WINDOW[:-1], [0.0, 0.0])
_LONGEST_STRETCH = 32.0
"""Below 1/32 of the input's rate the filter against aliases widens no further, so that memory is bounded."""
_LARGEST_STEP = 0.5
"""Turns from one sample to the next beyond which an angle cannot be told from another."""
_HISTORY = int(_LOBES * _LONGEST_STRETCH) + 2


def angle_turns(angle: NDArray[np.floating]) -> NDArray[np.float64]:
    """Turns of samples whose unwrapped crank angle in rad, shape (n,), was taken with them."""
    return np.asarray(angle, dtype=np.float64) / (2 * np.pi)


def turns_at(
    times: NDArray[np.floating], known_times: NDArray[np.floating], known_turns: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Turns at `times` in s, shape (n,), from those known at other times, both of shape (k,).

    A cubic spline through the known ones, exact up to an angular acceleration that grows evenly; NaN before
    the first and after the last. `known_times` must grow. With a mark each revolution `known_turns` is 0, 1,
    2 ...: a straight line between marks would be off by (acceleration x interval^2)/8, 3 to 4 degrees early
    in a run-up from 300 to 1500 rpm within 10 s.
    """
    if len(known_times) <= 1:
        return np.full(len(times), np.nan)
    spline = CubicSpline(known_times, known_turns, extrapolate=False)
    return np.asarray(spline(times), dtype=np.float64)


def smooth_turns(turns: NDArray[np.floating], samples: int) -> NDArray[np.float64]:
    """Turns less the steps of an encoder that counts: local cubics over an odd number of `samples`.

    The stretch should hold tens of counts and be short against the fastest change of speed that is to stay.
    Savitzky and Golay 1964, doi:10.1021/ac60214a047.
    """
    return np.asarray(savgol_filter(np.asarray(turns, dtype=np.float64), samples, _CUBIC))


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
        late = base + 1 + np.ceil(_LOBES * stretch).astype(np.int64) >= self._end
        count = int(np.argmax(late)) if late.any() else len(late)
        first = self._end - self._kept.shape[1]
        found = _between(self._kept, base[:count] - first, fraction[:count], stretch[:count])
        self._base, self._fraction = base[count:], fraction[count:]
        self._index += count
        needed = int(min(self._base[0], self._end)) if len(self._base) else self._end
        self._kept = self._kept[:, max(needed - _HISTORY - first, 0) :].copy()
        return found


def warm_up() -> None:
    """Compile what `AngleSampler` needs, ahead of its first block."""
    _between(np.zeros((1, 1)), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))


@njit(cache=True, nogil=True)
def _between(
    values: NDArray[np.float64],
    base: NDArray[np.int64],
    fraction: NDArray[np.float64],
    stretch: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Values between the samples of `values`, shape (channels, n), as (channels, k).

    Output i lies `fraction[i]` (0 to 1) samples after sample `base[i]`; the kernel is `stretch[i]` (1 or
    more) times as long as between samples. Each output depends on its own samples alone, to the bit. It is
    NaN if one of them is; samples before the first and after the last are taken for the first and the last.
    """
    channels, last = len(values), values.shape[1] - 1
    found = np.empty((channels, len(base)))
    weighted = np.empty(channels)
    for output in range(len(base)):
        reach = int(np.ceil(_LOBES * stretch[output]))
        total = 0.0
        weighted[:] = 0.0
        for tap in range(-reach, reach + 2):
            place = abs((tap - fraction[output]) / stretch[output]) * _STEPS
            if place >= _LOBES * _STEPS:
                continue
            entry = int(place)
            weight = _KERNEL[entry] + (place - entry) * (_KERNEL[entry + 1] - _KERNEL[entry])
            if weight == 0.0:  # not times zero: a sample out of reach may be NaN
                continue
            total += weight
            taken = min(max(base[output] + tap, 0), last)
            for channel in range(channels):
                weighted[channel] += weight * values[channel, taken]
        found[:, output] = weighted / total
    return found


@dataclass(frozen=True, slots=True)
class SynchronousAverage:
    """The mean of whole cycles at even phases 0, 1/points ..., in the channel's unit.

    `mean` and `standard_error` (the deviation of the mean) have shape (points,) or (channels, points),
    `cycles` shape () or (channels,). NaN where there is no cycle, and fewer than two for the standard error.
    """

    mean: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    cycles: NDArray[np.intp]


class CycleAverage:
    """Mean cycle, at `points` even phases, of samples in blocks of any size; the cuts leave no trace.

    Only whole cycles count, and none with a sample that is flagged or not finite. What varies faster than
    0.44 `points` times a cycle is filtered out: an impact keeps its peak only if `points` is near the number
    of samples in a cycle.
    """

    def __init__(self, points: int) -> None:
        self._points = points
        self._sampler = AngleSampler(points)
        self._part = np.empty((1, 0))  # of the cycle that has begun
        self._count = np.zeros(1, dtype=np.intp)
        self._mean = np.full((1, points), np.nan)
        self._squares = np.zeros((1, points))  # of deviations from the mean, added up
        self._single = True

    def add(
        self,
        values: NDArray[np.floating],
        turns: NDArray[np.floating],
        flagged: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take the next samples; arguments and errors as in `AngleSampler.add`."""
        first, news = self._sampler.add(values, turns, flagged)
        self._single = news.ndim == 1
        news = np.atleast_2d(news)
        if not self._part.size:
            news = news[:, -first % self._points :]
            self._part = np.empty((len(news), 0))
            if len(self._count) != len(news):
                self._count = np.zeros(len(news), dtype=np.intp)
                self._mean = np.full((len(news), self._points), np.nan)
                self._squares = np.zeros((len(news), self._points))
        part = np.concatenate((self._part, news), axis=1)
        whole = part.shape[1] // self._points * self._points
        for start in range(0, whole, self._points):
            # Welford 1962, doi:10.1080/00401706.1962.10490022.
            cycle = part[:, start : start + self._points]
            good = ~np.isnan(cycle).any(axis=1)
            self._count[good] += 1
            count = self._count[good][:, None]
            mean = np.where(count == 1, cycle[good], self._mean[good])
            off = cycle[good] - mean
            mean = mean + off / count
            self._mean[good] = mean
            self._squares[good] += off * (cycle[good] - mean)
        self._part = part[:, whole:].copy()

    def result(self) -> SynchronousAverage:
        count = np.where(self._count > 1, self._count, np.nan)[:, None]
        error = np.sqrt(self._squares / (count - 1) / count)
        one = 0 if self._single else slice(None)
        return SynchronousAverage(self._mean[one].copy(), error[one], np.asarray(self._count[one]).copy())


def synchronous_average(
    values: NDArray[np.floating],
    turns: NDArray[np.floating],
    points: int,
    flagged: NDArray[np.bool_] | None = None,
) -> SynchronousAverage:
    """What `CycleAverage` finds in a whole record."""
    average = CycleAverage(points)
    average.add(values, turns, flagged)
    return average.result()
