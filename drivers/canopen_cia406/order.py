"""Frames without a counter put in order and numbered by their timestamps: duplicates, reorder, loss."""

from __future__ import annotations

import bisect
import math
from typing import NamedTuple

HOLD = 4
"""Frames that wait for one that was overtaken."""
_SAME = 0.25
"""Two frames with the same counts closer than this share of a period are one frame, sent twice."""
_STEP_S = 0.1
"""A clock that moved by more than this against ours was set; transport only ever delays."""
_FOLLOW = 1e-3
"""How fast two clocks may drift apart before it is a step."""
_LEAST = 50
"""Frames from which on the measured period is used."""
_FURTHEST = 0.01
"""The measured period is not used where it is this far from the nominal one: too much is missing."""


class PositionFrame(NamedTuple):
    """A position as it came; sorts by its timestamp."""

    timestamp_s: float
    arrival_s: float
    counts: int


class Placed(NamedTuple):
    """A frame with its number; `stepped` where the clock of the timestamps was set just before it."""

    number: int
    frame: PositionFrame
    stepped: bool


class FrameOrder:
    """Numbers frames that are sent every `period_s`; each is given back once `HOLD` later ones are there."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._held: list[PositionFrame] = []
        self._past: list[PositionFrame] = []
        self._newest: PositionFrame | None = None
        self._last: Placed | None = None
        self._stepped = False
        self._least_delay_s = math.inf
        self._line = _Line()
        self.frames = self.missing = self.duplicates = self.reordered = self.late = self.clock_steps = 0

    @property
    def period_s(self) -> float:
        """Period in the clock of the timestamps (least squares), the nominal one until it can be told."""
        slope = self._line.slope
        return slope if abs(slope / self._period_s - 1.0) < _FURTHEST else self._period_s

    @property
    def period_ppm(self) -> float:
        """By how much the measured period is longer than the nominal one; NaN until it can be told."""
        return (self._line.slope / self._period_s - 1.0) * 1e6

    def put(self, frame: PositionFrame) -> list[Placed]:
        """Take a frame; return those that have their final place now, in order."""
        if self._is_duplicate(frame):
            self.duplicates += 1
            return []
        if self._last is not None and frame.timestamp_s < self._last.frame.timestamp_s:
            return self._from_the_past(frame)
        placed: list[Placed] = []
        if self._clock_went_ahead(frame):
            placed = self._new_line()
        self._give_up_past()
        self._hold(frame)
        if len(self._held) > HOLD:
            placed.append(self._place(self._held.pop(0)))
        return placed

    def flush(self) -> list[Placed]:
        """Return the frames that are still held; no more will come."""
        self._give_up_past()
        placed: list[Placed] = []
        while self._held:
            placed.append(self._place(self._held.pop(0)))
        return placed

    def _is_duplicate(self, frame: PositionFrame) -> bool:
        near_s = _SAME * self._period_s
        others = [*self._held] if self._last is None else [self._last.frame, *self._held]
        return any(
            frame.counts == other.counts and abs(frame.timestamp_s - other.timestamp_s) < near_s
            for other in others
        )

    def _from_the_past(self, frame: PositionFrame) -> list[Placed]:
        """One overtaken frame is too late; a run of them means that the clock was set back."""
        self._past.append(frame)
        if len(self._past) <= HOLD:
            return []
        past, self._past = self._past, []
        placed = self._new_line()
        for earlier in past:
            self._hold(earlier)
        placed.append(self._place(self._held.pop(0)))
        return placed

    def _give_up_past(self) -> None:
        self.late += len(self._past)
        self._past.clear()

    def _clock_went_ahead(self, frame: PositionFrame) -> bool:
        delay_s = frame.arrival_s - frame.timestamp_s
        before, newest = self._least_delay_s, self._newest
        since_s = 0.0 if newest is None else frame.arrival_s - newest.arrival_s
        self._least_delay_s = min(delay_s, before + _FOLLOW * since_s)
        if newest is None or delay_s > before - _STEP_S:
            return False
        return frame.timestamp_s - newest.timestamp_s - since_s > _STEP_S

    def _new_line(self) -> list[Placed]:
        placed = self.flush()
        self.clock_steps += 1
        self._stepped, self._newest, self._least_delay_s = True, None, math.inf
        self._line = _Line()
        return placed

    def _hold(self, frame: PositionFrame) -> None:
        if self._newest is not None and frame.timestamp_s < self._newest.timestamp_s:
            self.reordered += 1
        else:
            self._newest = frame
        bisect.insort(self._held, frame)

    def _place(self, frame: PositionFrame) -> Placed:
        stepped, self._stepped = self._stepped, False
        missing = 0 if self._last is None else self._missing_since(self._last.frame, frame, stepped)
        number = 0 if self._last is None else self._last.number + 1 + missing
        self.missing += missing
        self.frames += 1
        self._line.add(number, frame.timestamp_s)
        self._last = Placed(number, frame, stepped)
        return self._last

    def _missing_since(self, last: PositionFrame, frame: PositionFrame, stepped: bool) -> int:
        if stepped:  # only our own clock can tell; it sees delays of transport as well
            passed_s = frame.arrival_s - last.arrival_s
            return max(round(passed_s / self.period_s) - 1, 0) if passed_s >= _STEP_S else 0
        # Where the interface stamps by software, frames that waited in it come late and all at once: it is
        # the frame with the least delay, among this one and those held behind it, that tells.
        period_s, behind = self.period_s, (frame, *self._held)
        before = [
            round((each.timestamp_s - last.timestamp_s) / period_s) - n for n, each in enumerate(behind)
        ]
        return max(min(before) - 1, 0)


class _Line:
    """Least squares of timestamps over frame numbers, one point at a time."""

    def __init__(self) -> None:
        self._first: tuple[int, float] | None = None
        self._n = 0
        self._x = self._y = self._xx = self._xy = 0.0

    def add(self, number: int, timestamp_s: float) -> None:
        if self._first is None:
            self._first = (number, timestamp_s)
        x, y = number - self._first[0], timestamp_s - self._first[1]
        self._n += 1
        self._x += x
        self._y += y
        self._xx += x * x
        self._xy += x * y

    @property
    def slope(self) -> float:
        """Seconds a frame; NaN from too few."""
        if self._n < _LEAST:
            return math.nan
        return (self._n * self._xy - self._x * self._y) / (self._n * self._xx - self._x**2)
