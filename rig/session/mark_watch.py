"""The card's once-per-revolution mark in a run: where it was seen, and what was wrong with it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from daq.angle import MarkTracker
from daq.channel import Channel
from rig.session.shaft_speed import shows_marks

_MOST_MARKS = 4096


class MarkWatch:
    """Follows the marker, taken in the acquisition thread; `channel` is None where there is none.

    Counted is what was wrong while it was recorded: a shaft that comes up or runs out has no even marks.
    """

    def __init__(self, channels: Iterable[Channel]) -> None:
        self.channel = next((channel.name for channel in channels if shows_marks(channel)), None)
        self._tracker = MarkTracker()
        self._seen: deque[float] = deque(maxlen=_MOST_MARKS)
        self._missing = self._rejected = 0

    @property
    def marks(self) -> NDArray[np.float64]:
        """The latest marks that were seen, in samples since the card's start; shape (m,)."""
        return np.array(self._seen, np.float64)

    @property
    def fault(self) -> str:
        """What was wrong with the recorded marks, in words; empty for nothing."""
        if not (self._missing or self._rejected):
            return ""
        return (
            f"{self.channel}: {self._missing} marks missing in the record, put in evenly; "
            f"{self._rejected} edges rejected as no marks"
        )

    def take(self, values: NDArray[np.float64], recorded: bool) -> None:
        """Take the next samples of `channel`, shape (n,), and whether they belong to the record."""
        before = self._tracker.missing, self._tracker.extra
        marks, _ = self._tracker.track(values)
        self._seen.extend(marks.position[~marks.interpolated].tolist())
        if recorded:
            self._missing += self._tracker.missing - before[0]
            self._rejected += self._tracker.extra - before[1]
