"""Rms and peak of each cycle of a channel in one pass over its samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

_FRESH = (0.0, 0.0, np.inf, -np.inf)


class EndedCycles(NamedTuple):
    """Cycles that ended, oldest first, both of shape (m,): rms and largest magnitude, in the channel's unit.

    NaN where a sample was not finite or the cycle was spoilt.
    """

    rms: NDArray[np.float64]
    peak: NDArray[np.float64]


class CycleScanner:
    """Figures between given begins; how the samples are cut into blocks makes no difference, to the bit.

    Sums are taken one by one, as `CycleMeter` takes them, so that both find the same.
    """

    def __init__(self) -> None:
        self._state = np.array(_FRESH)

    def add(self, values: NDArray[np.floating], begins: NDArray[np.int64]) -> EndedCycles:
        """Take the next samples, shape (n,); `begins` are indices 0 to n, growing, at which a cycle begins.

        What ran before the first begin of all is the first row.
        """
        locked = values.view()
        locked.flags.writeable = False  # one compiled kernel for blocks of a card and of a log
        rows = np.empty((len(begins), len(_FRESH)))
        _scan(locked, begins, self._state, rows)
        rms = np.sqrt(rows[:, 1] / np.maximum(rows[:, 0], 1.0))
        peak = np.maximum(rows[:, 3], -rows[:, 2])
        peak[np.isnan(rms)] = np.nan
        return EndedCycles(rms, peak)

    def spoil(self) -> None:
        """The cycle that runs will have no figures."""
        self._state[1] = np.nan


def warm_up() -> None:
    """Compile ahead of the first block."""
    CycleScanner().add(np.zeros(1, np.float32), np.zeros(1, np.int64))


@njit(cache=True, nogil=True)
def _scan(
    values: NDArray[np.floating],
    begins: NDArray[np.int64],
    state: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> None:
    samples, square, minimum, maximum = state[0], state[1], state[2], state[3]
    start = 0
    for number in range(len(begins) + 1):
        end = begins[number] if number < len(begins) else len(values)
        for index in range(start, end):
            value = np.float64(values[index])
            square += value * value
            minimum = min(minimum, value)
            maximum = max(maximum, value)
        samples += end - start
        start = end
        if number < len(begins):
            rows[number, 0], rows[number, 1] = samples, square
            rows[number, 2], rows[number, 3] = minimum, maximum
            samples, square, minimum, maximum = 0.0, 0.0, np.inf, -np.inf
    state[0], state[1], state[2], state[3] = samples, square, minimum, maximum
