"""Rms and peak of each cycle of a channel in one pass over its samples."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from daq.signals.impact_events import ContactScanner

_STATE = 13
"""Samples of the cycle so far; then four sums of squares, four minima and four maxima."""


class CycleScanner:
    """Figures between given begins; how the samples are cut into blocks makes no difference, to the bit.

    The square of a cycle's sample i is added to sum i mod 4 of it, each sum in the order of the samples: four
    sums that do not wait for each other take a quarter of the time of one.
    """

    def __init__(self) -> None:
        self._state = np.empty(_STATE)
        _reset(self._state)

    def add(self, values: NDArray[np.floating], begins: NDArray[np.int64]) -> NDArray[np.float64]:
        """Take the next samples, shape (n,); `begins` are indices 0 to n, growing, at which a cycle begins.

        Returns rms and largest magnitude of what ended at each begin, shape (begins, 2), in the channel's
        unit; NaN where a sample was not finite or the cycle was spoilt, or where there was no sample.
        """
        locked = values.view()
        locked.flags.writeable = False  # one compiled kernel for blocks of a card and of a log
        rows = np.empty((len(begins), 2))
        _scan(locked, begins, self._state, rows)
        return rows

    def spoil(self) -> None:
        """The cycle that runs will have no figures."""
        self._state[1] = np.nan


def warm_up() -> None:
    """Compile what looks at each block, for figures of cycles and for impacts, ahead of the first."""
    block = np.zeros(1, np.float32)
    CycleScanner().add(block, np.zeros(1, np.int64))
    ContactScanner(1.0).add(block)


@njit(cache=True, nogil=True)
def _reset(state: NDArray[np.float64]) -> None:
    state[:5] = 0.0
    state[5:9] = np.inf
    state[9:] = -np.inf


@njit(cache=True, nogil=True)
def _scan(
    values: NDArray[np.floating],
    begins: NDArray[np.int64],
    state: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> None:
    start = 0
    for number in range(len(begins) + 1):
        end = begins[number] if number < len(begins) else len(values)
        _take(values[start:end], state)
        start = end
        if number < len(begins):
            square = (state[1] + state[2]) + (state[3] + state[4])
            minimum, maximum = state[5:9].min(), state[9:].max()
            rms = np.sqrt(square / state[0]) if state[0] > 0.0 else np.nan
            rows[number, 0] = rms
            rows[number, 1] = max(maximum, -minimum) if rms == rms else np.nan
            _reset(state)


@njit(cache=True, nogil=True)
def _take(values: NDArray[np.floating], state: NDArray[np.float64]) -> None:
    count = len(values)
    lane = int(state[0]) % 4
    # up to the next multiple of four samples of the cycle, then four at a time, then the rest
    head = min((4 - lane) % 4, count)
    for index in range(head):
        _one(np.float64(values[index]), lane + index, state)
    tail = head + (count - head) // 4 * 4
    s0, s1, s2, s3 = state[1], state[2], state[3], state[4]
    l0, l1, l2, l3 = state[5], state[6], state[7], state[8]
    h0, h1, h2, h3 = state[9], state[10], state[11], state[12]
    for index in range(head, tail, 4):
        v0, v1 = np.float64(values[index]), np.float64(values[index + 1])
        v2, v3 = np.float64(values[index + 2]), np.float64(values[index + 3])
        s0, s1, s2, s3 = s0 + v0 * v0, s1 + v1 * v1, s2 + v2 * v2, s3 + v3 * v3
        l0, l1 = v0 if v0 < l0 else l0, v1 if v1 < l1 else l1
        l2, l3 = v2 if v2 < l2 else l2, v3 if v3 < l3 else l3
        h0, h1 = v0 if v0 > h0 else h0, v1 if v1 > h1 else h1
        h2, h3 = v2 if v2 > h2 else h2, v3 if v3 > h3 else h3
    state[1], state[2], state[3], state[4] = s0, s1, s2, s3
    state[5], state[6], state[7], state[8] = l0, l1, l2, l3
    state[9], state[10], state[11], state[12] = h0, h1, h2, h3
    for index in range(tail, count):
        _one(np.float64(values[index]), index - tail, state)
    state[0] += count


@njit(cache=True, nogil=True)
def _one(value: float, lane: int, state: NDArray[np.float64]) -> None:
    state[1 + lane] += value * value
    state[5 + lane] = min(state[5 + lane], value)
    state[9 + lane] = max(state[9 + lane], value)
