"""Frames without a counter put in order and numbered by their timestamps: duplicates, reorder, loss.

`Slots` tells which beat of the sender's timer a frame belongs to, by timestamps that only ever come late;
`FrameOrder` puts frames in order before. Both live in the thread of the link.
"""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Sequence
from itertools import compress, pairwise
from operator import sub
from typing import NamedTuple

HOLD = 4
"""Frames that wait for one that was overtaken."""
_PATIENCE_S = 0.05
"""So long frames wait until it is certain which are missing: interfaces that stamp by software stall less."""
_SAME = 0.25
"""Two frames with the same counts closer than this share of a period are one frame, sent twice."""
_STEP_S = 0.1
"""A clock that moved by more than this against ours was set; transport only ever delays."""
_FOLLOW = 1e-3
"""How fast two clocks may drift apart before it is a step."""
_MEMORY = 32
"""Frames that are remembered, to tell the beat by the least delayed of them."""
_LEAST_EMPTY, _BY_CHANCE = 0.25, 1e-5
"""Share of a beat in which no frame may have come, and how likely that would be if they came at random."""
_EARLIER = 0.5
"""Of a period: how much less than the least known delay one may be, where frames come whenever they like."""
_STALLED = 0.25
"""A frame that comes within less of a period after another one was held up together with it."""
_FEW = 20
"""So many frames may be missing in a row even where few came before: the nominal period is good enough."""
_LEAST = 50
"""Frames from which on the measured period is used."""
_FURTHEST = 0.01
"""The measured period is not used where it is this far from the nominal one: too much is missing."""


class Slot(NamedTuple):
    """A frame's number, and whether it is certain how far that is from the one before."""

    number: int
    certain: bool


class Slots:
    """Numbers frames that are sent every `period_s` and stamped when they come, in the order of sending.

    Exact, whatever is missing, where delays differ by less than half a period; up to 20 may be missing in a
    row, or as many as came before. A stall in which nothing is lost is told from missing frames by those that
    come after it, where these are given as well. Beyond that a number is given as not certain, from the first
    frame that may be missing until frames keep to their beat again. From there on numbers are certain once
    more, counted from the last uncertain one: by what that is off, they stay off. No timestamp shows only
    this: a frame that is late by whole periods while exactly those that would betray it are missing.
    """

    def __init__(self, period_s: float) -> None:
        self._nominal_s = period_s
        self._line = _Line()
        self._recent: deque[tuple[int, float]] = deque(maxlen=_MEMORY)
        self._free: deque[bool] = deque(maxlen=_MEMORY)
        self._missing = False
        self._unsure = False

    @property
    def period_s(self) -> float:
        """Period in the clock of the timestamps (least squares), the nominal one until it can be told."""
        slope = self._line.slope
        return slope if abs(slope / self._nominal_s - 1.0) < _FURTHEST else self._nominal_s

    @property
    def period_ppm(self) -> float:
        """By how much the measured period is longer than the nominal one; NaN until it can be told."""
        return (self._line.slope / self._nominal_s - 1.0) * 1e6

    def first(self, stamps_s: Sequence[float]) -> Slot:
        """Number of the first of these frames, given those behind it, in the order of sending."""
        last, last_s = self._recent[-1]
        period_s = self.period_s
        known = [(stamp_s - last_s) / period_s - (number - last) for number, stamp_s in self._recent]
        behind = [(stamp_s - last_s) / period_s for stamp_s in stamps_s]
        free = [after for before, after in pairwise((0.0, *behind)) if after - before >= _STALLED]
        begin, even = _begin_of_beat(min(known), [*compress(known, self._free), *free])
        slots = [last + math.floor(each - begin) for each in behind]
        latest = slots[-1]
        for slot in reversed(slots[:-1]):  # a frame comes before those behind it
            latest = min(latest - 1, slot)
        stalled = latest < slots[0] or behind[0] < _STALLED
        missing = latest - last - 1
        if missing > 0:
            certain = even and not stalled and missing <= max(self._line.count, _FEW)
        else:  # fewer than none: those that were said to be missing were not
            certain = (even or len(known) == _MEMORY) and not (missing < 0 and self._missing)
        if self._unsure:
            certain = certain and even and not stalled
        return Slot(max(latest, last + 1), certain)

    def take(self, slot: Slot, stamp_s: float) -> None:
        """Remember where a frame was put."""
        last, last_s = self._recent[-1] if self._recent else (slot.number - 1, -math.inf)
        some_missing = slot.number > last + 1
        self._missing |= some_missing
        self._unsure = not slot.certain and (some_missing or self._unsure)
        self._free.append(stamp_s - last_s >= _STALLED * self._nominal_s)
        self._recent.append((slot.number, stamp_s))
        self._line.add(slot.number, stamp_s)


def _begin_of_beat(punctual: float, stamps: list[float]) -> tuple[float, bool]:
    """Where the beat of the least delayed frame, `punctual`, begins, and whether frames keep to a beat.

    It begins in the middle of the widest part of a period, modulo 1, in which none of `stamps` came.
    """
    phases = sorted(each % 1.0 for each in (punctual, *stamps))
    ends = [*phases[1:], phases[0] + 1.0]
    empty, end = max(zip(map(sub, ends, phases), ends, strict=True))
    if empty < _LEAST_EMPTY or len(phases) * (1.0 - empty) ** (len(phases) - 1) > _BY_CHANCE:
        return punctual - _EARLIER, False
    return punctual - (punctual - end + empty / 2.0) % 1.0, True


class _Line:
    """Least squares of timestamps over frame numbers, one point at a time."""

    def __init__(self) -> None:
        self._first: tuple[int, float] | None = None
        self.count = 0
        self._x = self._y = self._xx = self._xy = 0.0

    def add(self, number: int, timestamp_s: float) -> None:
        if self._first is None:
            self._first = (number, timestamp_s)
        x, y = number - self._first[0], timestamp_s - self._first[1]
        self.count += 1
        self._x += x
        self._y += y
        self._xx += x * x
        self._xy += x * y

    @property
    def slope(self) -> float:
        """Seconds a frame; NaN from too few."""
        if self.count < _LEAST:
            return math.nan
        return (self.count * self._xy - self._x * self._y) / (self.count * self._xx - self._x**2)


def most_held(period_s: float) -> int:
    """Frames sent every `period_s` that wait until it is certain which are missing."""
    return max(HOLD, round(_PATIENCE_S / period_s))


class PositionFrame(NamedTuple):
    """A position as it came; sorts by its timestamp."""

    timestamp_s: float
    arrival_s: float
    counts: int


class Placed(NamedTuple):
    """A frame with its number; `stepped` where the clock of the timestamps was set just before it.

    `certain`: how many are missing before it cannot be another number; what an uncertain one before it is
    off, it is off as well. See `Slots`.
    """

    number: int
    frame: PositionFrame
    stepped: bool
    certain: bool = True


class FrameOrder:
    """Numbers frames that are sent every `period_s`; each is given back once `HOLD` later ones are there.

    Where it is not certain what is missing before it, it waits for up to `most_held`; see `Slots`.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._most_held = most_held(period_s)
        self._held: list[PositionFrame] = []  # in the order of their timestamps
        self._past: list[
            PositionFrame
        ] = []  # older than what has been placed: too late, or of a clock set back
        self._newest: PositionFrame | None = None  # by timestamp
        self._last: Placed | None = None
        self._stepped = False
        self._least_delay_s = math.inf
        self._slots = Slots(period_s)  # anew after each step of the clock
        self.frames = self.missing = self.duplicates = self.reordered = self.late = self.clock_steps = 0
        self.uncertain = 0

    @property
    def period_ppm(self) -> float:
        """By how much the measured period is longer than the nominal one; NaN until it can be told."""
        return self._slots.period_ppm

    def put(self, frame: PositionFrame) -> list[Placed]:
        """Take a frame; return those that have their final place now, in order."""
        near_s = _SAME * self._period_s
        others = [*self._held] if self._last is None else [self._last.frame, *self._held]
        if any(
            frame.counts == other.counts and abs(frame.timestamp_s - other.timestamp_s) < near_s
            for other in others
        ):
            self.duplicates += 1
            return []
        # Its place is gone: what has been handed out cannot be taken back. One overtaken frame is too late;
        # a run of them means that the clock was set back.
        if self._last is not None and frame.timestamp_s < self._last.frame.timestamp_s:
            self._past.append(frame)
            if len(self._past) <= HOLD:
                return []
            past, self._past = self._past, []
            placed = self._new_line()
            for earlier in past:
                self._hold(earlier)
            return placed + self._place_ripe()
        placed = self._new_line() if self._clock_went_ahead(frame) else []
        self._give_up_past()
        self._hold(frame)
        return placed + self._place_ripe()

    def flush(self) -> list[Placed]:
        """Return the frames that are still held; no more will come."""
        self._give_up_past()
        placed: list[Placed] = []
        while self._held:
            placed.append(self._place(self._slot()))
        return placed

    def _give_up_past(self) -> None:
        self.late += len(self._past)
        self._past.clear()

    def _clock_went_ahead(self, frame: PositionFrame) -> bool:
        delay_s = frame.arrival_s - frame.timestamp_s
        before, newest = self._least_delay_s, self._newest
        since_s = 0.0 if newest is None else frame.arrival_s - newest.arrival_s
        # The quickest arrival so far, forgotten slowly: two crystals drift apart far less than _FOLLOW.
        self._least_delay_s = min(delay_s, before + _FOLLOW * since_s)
        if newest is None or delay_s > before - _STEP_S:
            return False
        # A frame that only came quicker than any before is no step: its time has to have leapt as well.
        return frame.timestamp_s - newest.timestamp_s - since_s > _STEP_S

    def _new_line(self) -> list[Placed]:
        placed = self.flush()
        self.clock_steps += 1
        self._stepped, self._newest, self._least_delay_s = True, None, math.inf
        return placed

    def _hold(self, frame: PositionFrame) -> None:
        if self._newest is not None and frame.timestamp_s < self._newest.timestamp_s:
            self.reordered += 1
        else:
            self._newest = frame
        bisect.insort(self._held, frame)

    def _place_ripe(self) -> list[Placed]:
        placed: list[Placed] = []
        while len(self._held) > HOLD:
            slot = self._slot()
            if not slot.certain and len(self._held) <= self._most_held:
                break
            placed.append(self._place(slot))
        return placed

    def _slot(self) -> Slot:
        """Number of the first frame that is held."""
        if self._last is None:
            return Slot(0, certain=True)
        if self._stepped:
            # By our own clock, which alone can tell; it sees delays of transport as well.
            passed_s = self._held[0].arrival_s - self._last.frame.arrival_s
            missing = max(round(passed_s / self._slots.period_s) - 1, 0) if passed_s >= _STEP_S else 0
            return Slot(self._last.number + 1 + missing, certain=not missing)
        return self._slots.first([frame.timestamp_s for frame in self._held])

    def _place(self, slot: Slot) -> Placed:
        frame = self._held.pop(0)
        if self._last is not None:
            self.missing += slot.number - self._last.number - 1
        if self._stepped:  # times of two clocks have no period between them
            self._slots = Slots(self._period_s)
        self._slots.take(slot, frame.timestamp_s)
        self.frames += 1
        self.uncertain += not slot.certain
        self._last = Placed(slot.number, frame, self._stepped, slot.certain)
        self._stepped = False
        return self._last
