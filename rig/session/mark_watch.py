"""The card's once-per-revolution mark in a run: where it was seen, and what was wrong with it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from daq.angle.marker import MarkTracker
from daq.channel import Channel
from rig.crank.shaft import shows_marks

_MOST_MARKS = 4096
_SAME_SPEED = 0.005
"""Two speeds of one shaft, over the same turns, lie nearer; a wrong number of pulses is farther off."""
_FEWEST_TURNS = 3


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

    def contradiction(self, name: str, zeros: NDArray[np.float64], begin: int, end: int) -> str:
        """How angle `name` contradicts the marks between two samples, in words; empty where it does not.

        `zeros`, shape (m,): where the angle passes whole turns, in samples since the card's start.
        """
        by_angle, by_mark = (_turn(marks[(marks >= begin) & (marks < end)]) for marks in (zeros, self.marks))
        if by_angle is None or by_mark is None:
            return ""
        if abs(by_mark - by_angle) <= _SAME_SPEED * by_angle + 1.0:  # a mark is known to a sample
            return ""
        return (
            f"{name} turns {by_mark / by_angle:.4g} times as fast as {self.channel}: pulses per turn of the "
            "one, loose or doubled mark of the other?"
        )

    def standing(self, skew: str, name: str) -> tuple[str, str]:
        """Code and words for how an encoder stands: to the mark, or to whatever angle `name` has its zero at.

        Without a mark that zero need not be the crank's, nor the same in the next run.
        """
        if self.channel is not None:
            return "encoder.at_mark", skew
        return "encoder.at_angle_zero", f"against the zero of {name}, not the crank's mark: {skew}"

    def take(self, values: NDArray[np.float64], recorded: bool) -> None:
        """Take the next samples of `channel`, shape (n,), and whether they belong to the record."""
        before = self._tracker.missing, self._tracker.extra
        marks, _ = self._tracker.track(values)
        self._seen.extend(marks.position[~marks.interpolated].tolist())
        if recorded:
            self._missing += self._tracker.missing - before[0]
            self._rejected += self._tracker.extra - before[1]


def _turn(marks: NDArray[np.float64]) -> float | None:
    """Samples of a turn, whatever single marks lack or are too many; None where there are too few."""
    return float(np.median(np.diff(marks))) if len(marks) > _FEWEST_TURNS else None
