"""What a run gives, measured, predicted or derived, live or replayed: one stream of records."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.log.reader import Origin
from daq.log.records import ClockRecord, Event, Gap, Impact


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive samples of one channel, and whose they are."""

    origin: Origin
    samples: SampleBlock


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
