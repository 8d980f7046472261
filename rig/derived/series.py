"""Collects the values of derived channels into blocks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.block import NS_PER_S, Flag, SampleBlock
from rig.stream import Block, Consumer


class Series:
    """Uniform series side by side, handed on in blocks of `per_block` values: then the log has few of them.

    `sample_rate` is theirs, `source_rate` that of the samples which they are computed from, whose sample 0 is
    at `start_ns`. Values that are left out begin a new block, which says so.
    """

    def __init__(
        self, channels: Sequence[str], sample_rate: float, per_block: int, source_rate: float, start_ns: int
    ) -> None:
        self._channels, self._rate, self._per_block = tuple(channels), sample_rate, per_block
        self._source_rate, self._start_ns = source_rate, start_ns
        self._first = self._next = 0
        self._sample = 0.0
        self._rows: list[Sequence[float]] = []

    def add(self, index: int, sample: float, values: Sequence[float], publish: Consumer) -> None:
        """Add value number `index` of each channel, which lies at `sample` of the source."""
        if self._rows and index != self._first + len(self._rows):
            self.flush(publish)
        if not self._rows:
            self._first, self._sample = index, sample
        self._rows.append(values)
        if len(self._rows) == self._per_block:
            self.flush(publish)

    def flush(self, publish: Consumer) -> None:
        """Hand on what is there."""
        if not self._rows:
            return
        columns = np.array(self._rows, dtype=np.float32).T
        missing = Flag.GOOD if self._first == self._next else Flag.SAMPLES_MISSING_BEFORE
        time_ns = self._start_ns + round(self._sample * NS_PER_S / self._source_rate)
        for channel, column in zip(self._channels, columns, strict=True):
            values = np.ascontiguousarray(column)
            flags = missing | (Flag.GOOD if np.isfinite(values).all() else Flag.NOT_FINITE)
            block = SampleBlock(channel, self._first, time_ns, self._rate, values, flags)
            publish(Block("derived", block))
        self._next = self._first + len(self._rows)
        self._rows = []
