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
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.errors import UnphysicalParameter

Array = NDArray[np.float64]

LOW_V, HIGH_V = 1.5, 3.5
"""For a mark of 0 and 5 V: far above its noise (0.02 V rms), and above the ringing of an anti-alias filter,
which swings by 9 % of a step."""
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


@dataclass(slots=True)
class _Passage:
    """What the next block must know of those before: values so far seen, the last one, the last rise."""

    count: int = 0
    last_v: float = np.nan
    is_high: bool | None = None
    last_low: int = -1
    crossing: float = np.nan


class Edges(NamedTuple):
    """Where edges lie (sample index from the first sample on) and the sample that made each certain; shape
    (m,)."""

    position: Array
    confirmed: NDArray[np.intp]


class RisingEdges:
    """Finds rising edges; how the samples are cut into blocks makes no difference.

    An edge counts once the signal, having been below `low_v`, is above `high_v`; it lies where the straight
    line between two samples passes the middle of the two. A signal that starts high has no edge there.
    Samples that are not finite are neither.
    """

    def __init__(self, low_v: float = LOW_V, high_v: float = HIGH_V) -> None:
        if not low_v < high_v:
            raise UnphysicalParameter(
                "marker", "lower threshold", low_v, f"below the upper one, {high_v:g} V"
            )
        self._low_v, self._high_v = low_v, high_v
        self._middle_v = (low_v + high_v) / 2
        self._passage = _Passage()

    @property
    def count(self) -> int:
        return self._passage.count

    def find(self, values_v: ArrayLike) -> Edges:
        """Edges that the next samples (V, shape (n,)) make certain."""
        values = np.asarray(values_v, np.float64)
        values = np.where(np.isfinite(values), values, np.nan)
        confirmed = self._confirmed(values)
        # where the signal rises through the middle: the sample after it, and its place between the two
        known = np.concatenate([[self._passage.last_v], values])
        below, above = known[:-1], known[1:]
        crossings = np.flatnonzero((below < self._middle_v) & (above >= self._middle_v))
        share = (self._middle_v - below[crossings]) / (above[crossings] - below[crossings])
        crossings = self._passage.count + crossings
        positions = crossings - 1 + share
        found = []
        for at, low in confirmed:
            latest = np.searchsorted(crossings, at, side="right") - 1
            position = positions[latest] if latest >= 0 else self._passage.crossing
            found.append(position if position >= low else float(at))
        if len(positions):
            self._passage.crossing = float(positions[-1])
        if len(values):
            self._passage.last_v = float(values[-1])
        self._passage.count += len(values)
        return Edges(np.array(found, np.float64), np.array([at for at, _ in confirmed], np.intp))

    def _confirmed(self, values: Array) -> list[tuple[int, int]]:
        """Samples at which an edge is certain, and the last low sample before each; from the start."""
        passage = self._passage
        decided = np.flatnonzero((values > self._high_v) | (values < self._low_v))
        found: list[tuple[int, int]] = []
        if not len(decided):
            return found
        high = values[decided] > self._high_v
        before = np.concatenate([[bool(passage.is_high) or passage.is_high is None], high[:-1]])
        for number in np.flatnonzero(high & ~before):
            low = passage.count + int(decided[number - 1]) if number else passage.last_low
            found.append((passage.count + int(decided[number]), low))
        passage.is_high = bool(high[-1])
        if not high.all():
            passage.last_low = passage.count + int(decided[np.flatnonzero(~high)[-1]])
        return found


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
