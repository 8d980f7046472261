"""Collects the values of a derived channel into blocks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from daq.block import Flag, SampleBlock


class Series:
    """A uniform series that is handed on in blocks of `per_block` values, so that the log has few of them.

    Values that are left out begin a new block, which says so.
    """

    def __init__(self, channel: str, sample_rate: float, per_block: int) -> None:
        self._channel, self._rate, self._per_block = channel, sample_rate, per_block
        self._first = self._time_ns = self._next = 0
        self._values: list[float] = []

    def add(self, index: int, time_ns: int, value: float, emit: Callable[[SampleBlock], None]) -> None:
        """Add value number `index`, of `time_ns`."""
        if self._values and index != self._first + len(self._values):
            self.flush(emit)
        if not self._values:
            self._first, self._time_ns = index, time_ns
        self._values.append(value)
        if len(self._values) == self._per_block:
            self.flush(emit)

    def flush(self, emit: Callable[[SampleBlock], None]) -> None:
        """Hand on what is there."""
        if not self._values:
            return
        values = np.array(self._values, dtype=np.float32)
        flags = Flag.GOOD if self._first == self._next else Flag.SAMPLES_MISSING_BEFORE
        flags |= Flag.GOOD if np.isfinite(values).all() else Flag.NOT_FINITE
        emit(SampleBlock(self._channel, self._first, self._time_ns, self._rate, values, flags))
        self._next, self._values = self._first + len(values), []
