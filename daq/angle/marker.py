"""Revolutions from a once-per-revolution mark, of which some are missing and some are none.

An interval is tested against the one before: 0.6 to 1.6 of it is a revolution; less, and the edge is an
extra one; more, and marks are missing, which are put in evenly and flagged. Of two edges that would both
do, the one nearer to a whole revolution is the mark, unless both are because the speed rose. More than
three missing in a row, or a shaft that stops, and the speed is not valid any more.

The test alone can lock onto half the speed: run up evenly from rest, the intervals are 1, 0.41, 0.32, ...,
so that the second edge is "extra", and every other one after it. And one glitch half way can lock it onto
twice the speed, every other mark "missing". So tracking begins with three intervals that agree, and begins
anew when four in a row agree with each other but not with it. What the test cannot tell: evenly braked to
rest, the last revolution takes 2.4 times the one before and is taken for two, one of them flagged.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log, tau

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.angle.edges import HIGH_V, LOW_V, RisingEdges

SHORTEST, LONGEST = 0.6, 1.6
"""Of the interval before: what passes for one revolution."""
MOST_MISSING = 3
"""Marks in a row that are put in; beyond, the shaft may do anything."""

_LOST = MOST_MISSING + 1.5
"""Intervals without a mark from which on more than three are missing."""
_EXTRA = 0.5
"""What an extra edge weighs: as much as a speed that changes by e^0.5 = 1.65 within a turn, just out of
bounds."""
_TO_LOCK, _TO_RELOCK = 3, 4


@dataclass(frozen=True, slots=True)
class Marks:
    """Passages of crank angle zero, every array of shape (m,): sample index, number of the turn that begins.

    `interpolated`: no edge was seen, the mark was put in. `restart`: how many turns passed before it is not
    known.
    """

    position: NDArray[np.float64]
    turn: NDArray[np.int64]
    interpolated: NDArray[np.bool_]
    restart: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.position)


@dataclass(frozen=True, slots=True)
class SpeedChange:
    """From sample `position` on the speed is valid, or is not."""

    position: float
    valid: bool


class MarkTracker:
    """Follows a marker block by block; how the samples are cut into blocks makes no difference.

    `extra`, `missing` and `lost` count rejected edges, marks put in and times that the speed became invalid.
    """

    def __init__(self, low_v: float = LOW_V, high_v: float = HIGH_V) -> None:
        self._edges = RisingEdges(low_v, high_v)
        self._recent: list[float] = []
        self._last = -inf
        self._fresh = True
        self._interval: float | None = None
        self._candidate: float | None = None
        self._turn = -1
        self._marks: list[tuple[float, int, bool, bool]] = []
        self._changes: list[SpeedChange] = []
        self.extra = self.missing = self.lost = 0

    @property
    def samples_per_turn(self) -> float | None:
        """Samples of the last revolution; None while the speed is not valid."""
        return self._interval

    def track(self, values_v: ArrayLike) -> tuple[Marks, list[SpeedChange]]:
        """Marks and changes of the speed's validity that the next samples (V, shape (n,)) bring to light.

        A mark that comes early is held back until a nearer one can no longer come.
        """
        edges = self._edges.find(values_v)
        for edge, confirmed in zip(edges.position.tolist(), edges.confirmed.tolist(), strict=True):
            self._wait_until(confirmed)
            self._recent = [*self._recent, edge][-_TO_RELOCK - 1 :]
            if self._interval is None:
                self._lock(_TO_LOCK)
                continue
            self._judge(edge, self._interval)
            if self._interval is None or len(self._recent) <= _TO_RELOCK or not _agree(self._recent):
                continue
            # The latest edges are evenly spaced; are they as they are tracked?
            ratio = (self._recent[-1] - self._recent[0]) / _TO_RELOCK / self._interval
            if not SHORTEST <= ratio <= LONGEST:
                self._lose(edge)
                self._lock(_TO_RELOCK)
        self._wait_until(self._edges.count)
        marks, self._marks = self._marks, []
        changes, self._changes = self._changes, []
        return _marks(marks), changes

    def _wait_until(self, now: int) -> None:
        """Accept the candidate once no nearer edge can come; give up once too many marks are missing."""
        if self._interval is None:
            return
        if self._candidate is not None:
            early = (self._candidate - self._last) / self._interval
            if now > self._last + self._interval / early:
                self._accept(self._candidate, self._interval)
        if now > self._last + _LOST * self._interval:
            self._lose(self._last + _LOST * self._interval)
            self._recent = []

    def _judge(self, edge: float, interval: float) -> None:
        ratio = (edge - self._last) / interval
        if self._candidate is not None and ratio >= SHORTEST:
            if not _better(ratio, (self._candidate - self._last) / interval):
                self._judge(edge, self._accept(self._candidate, interval))
                return
            self.extra += 1
        if ratio < SHORTEST:
            self.extra += 1
        elif ratio < 1:
            self._candidate = edge
        else:
            self._accept(edge, interval)

    def _accept(self, edge: float, interval: float) -> float:
        """Take an edge for a mark, put in those missing before it; returns the new interval."""
        passed = edge - self._last
        turns = 1 if passed <= LONGEST * interval else round(passed / interval)
        for number in range(1, turns):
            self._add(self._last + passed * number / turns, interpolated=True)
        self.missing += turns - 1
        self._add(edge)
        self._last, self._interval, self._candidate = edge, passed / turns, None
        return self._interval

    def _lock(self, intervals: int) -> None:
        """Begin to track if the latest edges are evenly spaced."""
        edges = self._recent[-intervals - 1 :]
        if len(edges) <= intervals or not _agree(edges):
            return
        for edge in edges:
            if edge > self._last:
                self._add(edge)
        self._last, self._interval, self._candidate = edges[-1], edges[-1] - edges[-2], None
        self._changes.append(SpeedChange(edges[-1], valid=True))

    def _lose(self, position: float) -> None:
        self._interval = self._candidate = None
        self._fresh = True
        self.lost += 1
        self._changes.append(SpeedChange(position, valid=False))

    def _add(self, position: float, interpolated: bool = False) -> None:
        self._turn += 1
        self._marks.append((position, self._turn, interpolated, self._fresh))
        self._fresh = False


def _better(later: float, earlier: float) -> bool:
    """Whether the later of two edges is the mark, given where both lie in terms of the interval before.

    Measured by how much the speed would have changed (logarithm of each ratio): the later one has to be
    nearer to a whole revolution, and that with an extra edge has to be likelier than both being marks.
    """
    if later > LONGEST or abs(log(later)) >= abs(log(earlier)):
        return False
    both = abs(log(earlier)) + abs(log((later - earlier) / earlier))
    return abs(log(later)) + _EXTRA < both


def _agree(edges: list[float]) -> bool:
    intervals = np.diff(edges)
    ratios = intervals[1:] / intervals[:-1]
    return bool(np.all((ratios >= SHORTEST) & (ratios <= LONGEST)))


def _marks(rows: list[tuple[float, int, bool, bool]]) -> Marks:
    position, turn, interpolated, restart = zip(*rows, strict=True) if rows else ((), (), (), ())
    return Marks(
        np.array(position, np.float64),
        np.array(turn, np.int64),
        np.array(interpolated, np.bool_),
        np.array(restart, np.bool_),
    )


@dataclass(frozen=True, slots=True)
class CrankAngle:
    """Crank angle in rad, unwrapped, NaN where no revolution was seen whole; shape (n,).

    `certain` is False there and in revolutions that begin or end with a mark that was put in.
    """

    angle_rad: NDArray[np.float64]
    certain: NDArray[np.bool_]


def crank_angle(marks: Marks, samples: ArrayLike) -> CrankAngle:
    """Angle at sample indices of shape (n,) (whole or not, on the marks' count), even within a revolution."""
    at = np.asarray(samples, np.float64)
    if len(marks) < 2:
        return CrankAngle(np.full(at.shape, np.nan), np.zeros(at.shape, np.bool_))
    turn = np.clip(np.searchsorted(marks.position, at, side="right") - 1, 0, len(marks) - 2)
    start, end = marks.position[turn], marks.position[turn + 1]
    seen = (at >= marks.position[0]) & (at <= marks.position[-1]) & ~marks.restart[turn + 1]
    angle = tau * (marks.turn[turn] + (at - start) / (end - start))
    put_in = marks.interpolated[turn] | marks.interpolated[turn + 1]
    return CrankAngle(np.where(seen, angle, np.nan), seen & ~put_in)
