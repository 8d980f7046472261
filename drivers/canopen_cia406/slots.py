"""Which beat of a sender's timer each of its frames belongs to, by timestamps that only ever come late."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import compress, pairwise
from operator import sub
from typing import NamedTuple

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
