"""Jumps of a clock, seen in how late its stamps arrive.

Late is arrival minus stamp. A delay only ever adds to it, and a host that stalls adds much, for a while, to
many in a row; a clock that jumps changes it for good, either way. So what is late for less than a few
seconds is taken for a stall, what is early or stays late for a jump.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import grey_opening

Array = NDArray[np.float64]

STALL_S = 5.0
"""A host that is late for no longer than this is taken to stall."""
SMALLEST_STEP_S = 1e-4
"""Least jump that is told from the drift within a window, however quiet the arrivals."""

_PAIRS = 5
"""Pairs of which the median stands for all: two spikes among them do not show."""
_BIN_S = 0.5
"""A tenth of a stall, so that leaving out stalls leaves the same of the noise at any rate of pairs."""
_WINDOW = 8
"""Medians on either side that a jump is judged by; jumps closer than this are seen as one."""
_LONG = 4 * _WINDOW
_POSSIBLE, _CERTAIN = 8.0, 16.0
"""Deviations of the differences, whose tails are longer than normal ones: from 8 a jump is possible and
must show over four times as many medians as well, from 16 it is certain."""
_STILL = 0.75
"""Share of a jump that is still there over the longer windows; chance spells of late arrivals have faded."""
_MAD_TO_SIGMA = 1.4826


def find_steps(late: Array, elapsed_s: Array) -> list[int]:
    """Indices of the first pair after each jump, in order.

    `late` and `elapsed_s` (seconds that passed since the first pair, not decreasing) have shape (n,). At ten
    pairs a second with 1 ms of jitter, jumps from some 1.5 ms on are found once 2 s have passed after them if
    they are early, 3 s if they are late. A slow drift is no jump.
    """
    pair_s = float(elapsed_s[-1]) / max(len(elapsed_s) - 1, 1)
    width = max(_PAIRS, min(round(_BIN_S / pair_s), len(elapsed_s)) if pair_s > 0 else 1)
    count = len(late) // width
    window = min(_WINDOW, count // 2)
    if window < 2:
        return []
    medians = np.median(late[: count * width].reshape(count, width), axis=1)
    bin_s = max(float(elapsed_s[count * width - 1]) / count, 1e-9)
    stall = min(int(max(_WINDOW - 1, STALL_S / bin_s)), count)
    level = grey_opening(medians, size=(2 * (stall // 2) + 1,))
    before, after = _levels_around(level, window)
    long_before, long_after = _levels_around(level, min(max(_LONG, window), len(level) // 2))
    jump, long_jump = _less_drift(after - before), _less_drift(long_after - long_before)
    deviation = _MAD_TO_SIGMA * float(np.median(np.abs(jump)))
    shows = (np.abs(jump) > _CERTAIN * deviation) | (np.abs(long_jump) > _STILL * np.abs(jump))
    jump[~shows] = 0.0
    usual = float(np.median(medians - level))
    found = []
    while abs(jump[at := int(np.argmax(np.abs(jump)))]) > max(_POSSIBLE * deviation, SMALLEST_STEP_S):
        low, high = max(at + 1 - window, 0) * width, (at + 1 + window) * width
        # Cut where the sum of distances to the level before and the level after is least.
        near, was, becomes = late[low:high], before[at] + usual, after[at] + usual
        gain = np.concatenate([[0.0], np.cumsum(np.abs(near - was) - np.abs(near - becomes))])
        found.append(low + int(np.argmin(gain)))
        jump[max(at - window, 0) : at + window + 1] = 0.0
    return sorted(found)


def _less_drift(jump: Array) -> Array:
    """Without what a drift adds to all of them alike."""
    return jump - float(np.median(jump))


def _levels_around(level: Array, window: int) -> tuple[Array, Array]:
    """Medians of `window` values before and after each boundary between two values, shape (n - 1,)."""
    padded = np.pad(level, window - 1, mode="symmetric")
    medians = np.median(sliding_window_view(padded, window), axis=1)
    boundaries = len(level) - 1
    return medians[:boundaries], medians[window : window + boundaries]
