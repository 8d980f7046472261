"""What a run gives, measured, predicted or derived, live or replayed: one stream of records."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock, values_of
from daq.log.records import ClockRecord, Event, Gap, Impact

if TYPE_CHECKING:
    from daq.log.reader import Origin  # the twin, which sends blocks, reads no log


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive samples of one channel, and whose they are."""

    origin: Origin
    samples: SampleBlock

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self.__slots__)


@dataclass(frozen=True, slots=True)
class Shape:
    """Where the twin's rig is at `time_s` since sample 0: points in m, as `Truth.shape` gives them."""

    time_s: float
    points_m: NDArray[np.floating]


@dataclass(frozen=True, slots=True)
class Metadata:
    """A metadata record of the log."""

    name: str
    record: Mapping[str, str]


Record = Block | Impact | Event | Gap | ClockRecord | Shape | Metadata
Consumer = Callable[[Record], None]
"""Takes a record, in the thread that brings it. It must not wait, and passes over what it has no use for."""


class Stream(list[Consumer]):
    """Who gets every record, in this order; called with one, hands it to all of them."""

    def __call__(self, record: Record) -> None:
        for consume in self:
            consume(record)


class LastSeconds:
    """Blocks of one channel that reach back `seconds`; samples that never came are NaN."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._blocks: deque[SampleBlock] = deque()

    def add(self, block: SampleBlock) -> None:
        """Append a block and forget what is too old; a block that goes back in time starts afresh."""
        if self._blocks and block.first_sample < self._blocks[-1].end_sample:
            self._blocks.clear()
        self._blocks.append(block)
        oldest = block.end_sample - round(self._seconds * block.sample_rate)
        while self._blocks[0].end_sample <= oldest:
            self._blocks.popleft()

    @property
    def first_sample(self) -> int:
        """Index of the oldest sample kept; 0 where there is none."""
        return self._blocks[0].first_sample if self._blocks else 0

    @property
    def end_sample(self) -> int:
        """Index after the newest sample; 0 where there is none."""
        return self._blocks[-1].end_sample if self._blocks else 0

    def between(self, first: int, end: int) -> NDArray[np.floating]:
        """Samples `first` up to `end` (excluded), shape (end - first,); NaN where none is kept."""
        wide = self._blocks[-1].values.dtype if self._blocks else np.float32
        return values_of(self._blocks, first, end, wide)
