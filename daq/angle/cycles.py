"""Cycles of a drive and revolutions of a crank: where they begin, as far as it is known by now."""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections import deque
from math import ceil, nan, tau
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from daq.angle.marker import MarkTracker
from daq.signals.sine import fit_sine

_PRUNE_FROM, _PRUNE_TO = 8192, 4096
"""Begins that are kept for channels that come later than others: minutes, even of a fast drive."""
END = 1 << 62
"""Past every sample."""
_WINDOW_S = 1.0
_POINTS_A_CYCLE = 16
WORST_RESIDUAL = 0.5
"""Rms, as a share of the amplitude: a drive with strong harmonics stays below 0.2, noise alone does not."""
Array = NDArray[np.float64]
KEPT_S = 8.0
"""Angles that are kept for impacts that end, with all their bounces, after they began."""
GIVE_UP_S = 6.0
"""How long the next mark is waited for: three revolutions at 40 rpm must pass before a marker is believed."""
_MOST_MARKS = 4096
_MOST_TURNS = 2.0**52


class Begins(NamedTuple):
    """Begins in a stretch of samples: number of the cycle, whether what ends there is a whole cycle.

    All of length m; `offset`, shape (m,), is the sample less the first one of the stretch.
    """

    offset: NDArray[np.int64]
    number: list[int]
    sound: list[bool]


class Cycles(Protocol):
    """Cycles as a reference channel shows them, block by block; the cuts leave no trace."""

    begins: KnownBegins

    def add(self, first_sample: int, values: NDArray[np.floating], usable: bool) -> None:
        """Take the reference channel's next samples, shape (n,); what is between two calls is missing."""

    def finish(self) -> None:
        """No more samples will come."""

    def turns_at(self, sample: int) -> float:
        """Turns at a sample that has been seen: cycles counted and the phase in one; NaN if not known."""


class KnownBegins:
    """Begins in growing order; all before sample `until` are known."""

    def __init__(self) -> None:
        self.until = 0
        self.first_number: int | None = None
        self._samples, self._numbers, self._sound = array("q"), array("q"), array("b")
        self._asked = (0, 0)
        self._answer = Begins(np.empty(0, np.int64), [], [])

    def note(self, sample: int, number: int, sound: bool = True) -> None:
        """Note a begin; one that comes before `until`, too late for others to heed it, is left out."""
        if sample < self.until or (self._samples and sample <= self._samples[-1]):
            return
        if self.first_number is None:
            self.first_number = number
        follows = bool(self._numbers) and number == self._numbers[-1] + 1
        self._samples.append(sample)
        self._numbers.append(number)
        self._sound.append(sound and follows)
        if len(self._samples) > _PRUNE_FROM:
            for row in (self._samples, self._numbers, self._sound):
                del row[:-_PRUNE_TO]

    def between(self, start: int, end: int) -> Begins:
        """Begins from sample `start` to `end` (excluded), which is not beyond `until`."""
        if (start, end) != self._asked:  # the channels of a card come in blocks of the same samples
            low, high = bisect_left(self._samples, start), bisect_left(self._samples, end)
            offset = np.array(self._samples[low:high], dtype=np.int64) - start
            self._asked = start, end
            sound = [bool(each) for each in self._sound[low:high]]
            self._answer = Begins(offset, self._numbers[low:high].tolist(), sound)
        return self._answer


class DriveCycles:
    """A sine of given `frequency` (Hz) and `phase` (rad, at sample 0) whose phase is renewed as it goes.

    Each second of the drive (whole cycles) is fitted at that frequency, and the phase found holds for the
    second but one after it, so that begins are known ahead of every channel: a clock that is off by some ppm
    adds up to nothing. A second that shows no such sine (beside it more than `worst` of its amplitude, rms),
    or has samples missing, leaves the phase as it is.
    """

    def __init__(
        self, sample_rate: float, frequency: float, phase: float, worst: float = WORST_RESIDUAL
    ) -> None:
        self.begins = KnownBegins()
        self._rate, self._frequency, self._step = sample_rate, frequency, frequency / sample_rate
        self._worst = worst
        cycles = max(round(_WINDOW_S * frequency), 1)
        self._window = round(cycles * sample_rate / frequency)
        self._mean_of = max(int(sample_rate / (frequency * _POINTS_A_CYCLE)), 1)
        self._parts: list[NDArray[np.floating]] = []
        self._sound = True
        self._next = 0
        self._offsets = array("d")
        self._number = ceil(phase / tau)
        self._open(phase / tau)

    def add(self, first_sample: int, values: NDArray[np.floating], usable: bool = True) -> None:
        """Take the next samples of the drive, shape (n,); what lies between two calls is missing."""
        while self._next < first_sample:
            self._pass(min(first_sample, self._end) - self._next, None)
        while len(values):
            part = values[: self._end - self._next]
            values = values[len(part) :]
            self._pass(len(part), part if usable else None)

    def finish(self) -> None:
        """No more samples will come: the last phase holds for those of other channels."""
        self.begins.until = END

    def turns_at(self, sample: int) -> float:
        """Cycles since the rising zero that lies before sample 0."""
        window = min(sample // self._window, len(self._offsets) - 1)
        return sample * self._step + self._offsets[window]

    @property
    def _end(self) -> int:
        """End of the window that is being collected."""
        return (len(self._offsets) - 1) * self._window

    def _pass(self, count: int, part: NDArray[np.floating] | None) -> None:
        self._next += count
        if part is None:
            self._sound = False
        else:
            self._parts.append(part)
        if self._next == self._end:
            offset = self._offsets[-1]
            self._open(offset + self._late(offset) if self._sound else offset)
            self._parts, self._sound = [], True

    def _open(self, offset: float) -> None:
        """Let the next window begin, with every begin in it; the first opens the one that it was measured in
        as well."""
        first = not self._offsets
        self._offsets.extend([offset, offset] if first else [offset])
        start = 0 if first else (len(self._offsets) - 1) * self._window
        end = len(self._offsets) * self._window
        while (sample := max(self._begin_of(self._number, offset), start)) < end:
            self.begins.note(sample, self._number)
            self._number += 1
        self.begins.until = end

    def _begin_of(self, number: int, offset: float) -> int:
        """First sample whose turns are `number` or more, by the same rounding as `turns_at`."""
        sample = ceil((number - offset) / self._step)
        while sample * self._step + offset < number:
            sample += 1
        while (sample - 1) * self._step + offset >= number:
            sample -= 1
        return sample

    def _late(self, offset: float) -> float:
        """What the window's drive is ahead of `offset`, in turns; 0 where it shows no sine."""
        values = np.concatenate(self._parts).astype(np.float64)
        count = len(values) // self._mean_of * self._mean_of
        points = values[:count].reshape(-1, self._mean_of).mean(axis=1)
        if not np.isfinite(points).all():
            return 0.0
        fit = fit_sine(points, self._rate / self._mean_of, self._frequency, hold_frequency=True)
        if not 0.0 < fit.residual < self._worst * fit.amplitude:
            return 0.0
        first = self._end - self._window + (self._mean_of - 1) / 2
        late = fit.phase / tau - (first * self._step + offset)
        return float((late + 0.5) % 1.0 - 0.5)


class AngleCycles:
    """Revolutions of an unwrapped crank angle in rad; one that goes back stays in the revolution."""

    def __init__(self, sample_rate: float) -> None:
        self.begins = KnownBegins()
        self._kept = round(KEPT_S * sample_rate)
        self._recent: deque[tuple[int, Array]] = deque()
        self._furthest = -np.inf

    def add(self, first_sample: int, values: NDArray[np.floating], usable: bool = True) -> None:
        """Take the next angles, shape (n,)."""
        if not len(values):
            return
        turns = np.asarray(values, np.float64) / tau
        turns[~(np.abs(turns) < _MOST_TURNS)] = np.nan
        self._recent.append((first_sample, turns))
        while self._recent[0][0] < first_sample - self._kept:
            self._recent.popleft()
        way = np.fmax.accumulate(np.concatenate(([self._furthest], turns)))
        number = np.floor(way)
        for index in np.flatnonzero(number[1:] > number[:-1]).tolist():
            if np.isfinite(number[index]) or way[index + 1] == number[index + 1]:
                self.begins.note(first_sample + index, int(number[index + 1]), usable)
        self._furthest = float(way[-1])
        self.begins.until = first_sample + len(values)

    def finish(self) -> None:
        """No more angles will come."""
        self.begins.until = END

    def turns_at(self, sample: int) -> float:
        """Revolutions that the counter shows at a sample of the last seconds."""
        for first, turns in reversed(self._recent):
            if first <= sample < first + len(turns):
                return float(turns[sample - first])
        return nan


class MarkerCycles:
    """Revolutions between the marks of a marker in V; a shaft that stops has none until it turns again.

    The angle is taken to grow evenly from mark to mark, at which the crank has turned by `mark_turns`.
    """

    def __init__(self, sample_rate: float, mark_turns: float = 0.0) -> None:
        self.begins = KnownBegins()
        self._mark_turns = mark_turns
        self._give_up = round(GIVE_UP_S * sample_rate)
        self._tracker = MarkTracker()
        self._base = self._next = 0
        self._number_base = self._number = -1
        self._positions: list[float] = []
        self._turns: list[int] = []
        self._restarts: set[int] = set()

    def add(self, first_sample: int, values: NDArray[np.floating], usable: bool = True) -> None:
        """Take the next samples of the marker, shape (n,)."""
        if first_sample != self._next:
            self._tracker, self._base, self._number_base = MarkTracker(), first_sample, self._number
        marks, _ = self._tracker.track(values)
        rows = zip(marks.position.tolist(), marks.turn.tolist(), marks.restart.tolist(), strict=True)
        for position, turn, restart in rows:
            at, self._number = self._base + position, self._number_base + 1 + turn
            self._positions.append(at)
            self._turns.append(self._number)
            if restart:
                self._restarts.add(self._number)
            self.begins.note(ceil(at), self._number, not restart)
            self.begins.until = max(self.begins.until, ceil(at))
            if len(self._positions) > 2 * _MOST_MARKS:
                del self._positions[:_MOST_MARKS], self._turns[:_MOST_MARKS]
                self._restarts = {each for each in self._restarts if each >= self._turns[0]}
        self._next = first_sample + len(values)
        self.begins.until = max(self.begins.until, self._next - self._give_up)

    def finish(self) -> None:
        """No more samples will come."""
        self.begins.until = END

    def turns_at(self, sample: int) -> float:
        """Revolutions since crank angle 0 before the first mark."""
        at = self._turn_of(sample)
        if at is None:
            return nan
        start, end = self._positions[at], self._positions[at + 1]
        return self._mark_turns + self._turns[at] + (sample - start) / (end - start)

    def samples_per_turn(self, sample: float) -> float:
        """How long the revolution takes in which a sample lies, in samples; NaN if it is not known."""
        at = self._turn_of(sample)
        return nan if at is None else self._positions[at + 1] - self._positions[at]

    def _turn_of(self, sample: float) -> int | None:
        at = bisect_right(self._positions, sample) - 1
        if not 0 <= at < len(self._positions) - 1 or self._turns[at + 1] in self._restarts:
            return None
        return at if self._positions[at + 1] - self._positions[at] <= self._give_up else None
