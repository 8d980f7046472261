"""Time-synchronous averaging: the mean cycle of a channel, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.signals.even_angles import AngleSampler


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
        """The average so far."""
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
