"""Frames without a counter put in order and numbered by their timestamps: duplicates, reorder, loss."""

from __future__ import annotations

import bisect
import math
from typing import NamedTuple

from drivers.canopen_cia406.slots import Slot, Slots

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
        self._held: list[PositionFrame] = []
        self._past: list[PositionFrame] = []
        self._newest: PositionFrame | None = None
        self._last: Placed | None = None
        self._stepped = False
        self._least_delay_s = math.inf
        self._slots = Slots(period_s)
        self.frames = self.missing = self.duplicates = self.reordered = self.late = self.clock_steps = 0
        self.uncertain = 0

    @property
    def period_ppm(self) -> float:
        """By how much the measured period is longer than the nominal one; NaN until it can be told."""
        return self._slots.period_ppm

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
        return placed + self._place_ripe()

    def flush(self) -> list[Placed]:
        """Return the frames that are still held; no more will come."""
        self._give_up_past()
        placed: list[Placed] = []
        while self._held:
            placed.append(self._place(self._slot()))
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
        return placed + self._place_ripe()

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
            missing = self._missing_over_step()
            return Slot(self._last.number + 1 + missing, certain=not missing)
        return self._slots.first([frame.timestamp_s for frame in self._held])

    def _missing_over_step(self) -> int:
        """By our own clock, which alone can tell; it sees delays of transport as well."""
        if self._last is None:
            return 0
        passed_s = self._held[0].arrival_s - self._last.frame.arrival_s
        return max(round(passed_s / self._slots.period_s) - 1, 0) if passed_s >= _STEP_S else 0

    def _place(self, slot: Slot) -> Placed:
        frame = self._held.pop(0)
        if self._last is not None:
            self.missing += slot.number - self._last.number - 1
        if self._stepped:
            self._slots = Slots(self._period_s)
        self._slots.take(slot, frame.timestamp_s)
        self.frames += 1
        self.uncertain += not slot.certain
        self._last = Placed(slot.number, frame, self._stepped, slot.certain)
        self._stepped = False
        return self._last
