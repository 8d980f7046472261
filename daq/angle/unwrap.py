"""Counters that roll over, unwrapped exactly: angles of encoders, counts of edges.

Between two readings a counter is taken to have moved the shorter way round. That is right up to half its
range; beyond, the other way is shorter and the count is wrong by a whole range without a trace. So whoever
knows the largest step (top speed over reading rate) says so, and a step above it is ambiguous, as is
exactly half.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.errors import UnphysicalParameter

Counts = NDArray[np.int64]

_LARGEST_RANGE = 1 << 62
"""Differences of two readings still fit into 64 bits."""


@dataclass(frozen=True, slots=True)
class Unwrapped:
    """Counts since a reading of 0, rollovers counted, and which of them cannot be trusted; both of shape
    (n,).

    Where a count is ambiguous it took the shorter way; those after it may be off by whole ranges.
    """

    counts: Counts
    ambiguous: NDArray[np.bool_]


class Unwrapper:
    """Unwraps a counter block by block; how the readings are cut into blocks makes no difference."""

    def __init__(self, counter_range: int, largest_step: int | None = None) -> None:
        """`counter_range`: counts from one rollover to the next, such as 1 << 16 or 65,536 a turn times
        turns.

        `largest_step`: counts that it can move from one reading to the next (default: below half the range).
        """
        half = (counter_range - 1) // 2
        most = half if largest_step is None else largest_step
        if not 3 <= counter_range <= _LARGEST_RANGE:
            raise UnphysicalParameter("counter", "range", counter_range, f"3 to {_LARGEST_RANGE} counts")
        if not 0 < most <= half:
            raise UnphysicalParameter(
                "counter", "largest step", most, f"1 to {half} counts: below half the range"
            )
        self._range, self._most = counter_range, most
        self._last_raw: int | None = None
        self._last_count = 0

    def unwrap(self, raw: ArrayLike, missing_before: int = 0) -> Unwrapped:
        """Unwrap the next readings, integers of shape (n,) of any width, signed or not.

        `missing_before` readings are known to be lost before the first: it may have moved that much further.
        A reading that the counter cannot show is ambiguous.
        """
        readings = np.asarray(raw)
        if readings.size and not np.issubdtype(readings.dtype, np.integer):
            raise UnphysicalParameter(
                "counter", "reading", float("nan"), "integers; a float has been scaled already"
            )
        values = readings.astype(np.int64)
        if not len(values):
            return Unwrapped(values, np.zeros(0, np.bool_))
        before = int(values[0]) if self._last_raw is None else self._last_raw
        if self._last_raw is None:
            self._last_count = before
        half = self._range // 2
        steps = (np.diff(values, prepend=before) + half) % self._range - half  # the shorter way
        most = np.full(len(values), self._most)
        over_missing = (missing_before + 1) * self._most if self._last_raw is not None else 0
        most[0] = over_missing if over_missing <= (self._range - 1) // 2 else -1  # every step is ambiguous
        ambiguous = (np.abs(steps) > most) | (values < -(self._range // 2)) | (values >= self._range)
        counts = self._last_count + np.cumsum(steps)
        self._last_raw, self._last_count = int(values[-1]), int(counts[-1])
        return Unwrapped(counts, ambiguous)
