"""A run of consecutive samples of one channel."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

NS_PER_S = 1_000_000_000
LATEST = 1 << 63
"""Time in ns and index of a sample, as they are counted anywhere, end before."""


class Flag(IntFlag):
    """What is known to be wrong with a block; the values are those of the log format."""

    GOOD = 0
    OVERLOAD = 1
    OPEN_SENSOR = 2
    SAMPLES_MISSING_BEFORE = 4
    CLOCK_NOT_LOCKED = 8
    NOT_FINITE = 16


BLIND = Flag.OVERLOAD | Flag.OPEN_SENSOR | Flag.NOT_FINITE
"""Flags of a block whose values do not show what the sensor should see."""


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """Consecutive samples of one channel on the run's time base.

    `first_sample` counts from the start of recording; `time_ns` is the time of that sample (Unix epoch, ns);
    `sample_rate` is the device's own, in Hz; `values` has shape (n,) and the channel's unit.
    """

    channel: str
    first_sample: int
    time_ns: int
    sample_rate: float
    values: NDArray[np.floating]
    flags: Flag = Flag.GOOD

    # That of a dataclass with slots walks its fields, at both ends.
    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self.__slots__)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def end_sample(self) -> int:
        """Index of the first sample after this block."""
        return self.first_sample + len(self.values)

    def before(self, time_ns: int | None) -> SampleBlock:
        """Its samples before that time; None: all of them."""
        if time_ns is None:
            return self
        count = math.ceil((time_ns - self.time_ns) * self.sample_rate / NS_PER_S)
        return self if count >= len(self) else replace(self, values=self.values[: max(count, 0)])

    def times_s(self) -> NDArray[np.float64]:
        """Times of the samples in seconds since the start of recording, shape (n,)."""
        return (self.first_sample + np.arange(len(self.values))) / self.sample_rate


def values_of(
    blocks: Iterable[SampleBlock], first: int, end: int, dtype: DTypeLike = np.float64
) -> NDArray[Any]:
    """Samples `first` up to `end` (excluded) of blocks of one channel; NaN where none of them has it."""
    values = np.full(max(end - first, 0), np.nan, dtype)
    for block in blocks:
        low, high = max(block.first_sample, first), min(block.end_sample, end)
        if low < high:
            values[low - first : high - first] = block.values[
                low - block.first_sample : high - block.first_sample
            ]
    return values


def merged(blocks: Iterable[SampleBlock]) -> list[SampleBlock]:
    """The same samples of one channel in as few blocks as holes and flags allow."""
    runs: list[list[SampleBlock]] = []
    for block in blocks:
        last = runs[-1][-1] if runs else None
        if last is None or (last.end_sample, last.flags) != (block.first_sample, block.flags):
            runs.append([])
        runs[-1].append(block)
    return [replace(run[0], values=np.concatenate([each.values for each in run])) for run in runs]


def as_logged(channel: str, values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Values as wide as a log keeps them: an unwrapped angle is too long for 32 bits."""
    return values.astype(np.float64 if channel.endswith(".angle") else np.float32, copy=False)


def is_rate(sample_rate: float) -> bool:
    """Whether times and indices at so many Hz can be reckoned."""
    return 1e-9 < sample_rate < 1e18


def sample_time_ns(start_ns: int, index: int, sample_rate: float) -> int:
    """Time in ns of sample `index` on a base that starts at `start_ns` and runs at `sample_rate` Hz."""
    return start_ns + round(index * NS_PER_S / sample_rate)
