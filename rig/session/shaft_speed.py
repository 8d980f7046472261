"""How fast the crank turns, as the card's channels show it while a run goes on."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.angle.marker import MOST_MISSING, MarkTracker
from daq.channel import Channel
from daq.clock import Clock
from rig.rigs import shaft_channel, shows_marks, shows_speed

RPM_PER_RAD_S = 60.0 / math.tau
STALE_S = 0.5
"""A speed that is older tells nothing of the shaft any more: a card's blocks come every 0.075 s."""
_KEPT_S = 61.0
"""A turn at 1 rpm, the slowest that a scenario may ask for; of faster turns the last one is kept."""
_POINT_S = 0.005  # a point of the angle is kept so often: 20 within `_LATEST_S`
_LATEST_S = 0.1  # what counts as now: a block of the card and a little of the last
STANDS_RPM = 2.0
"""A tachometer that shows less may stand on a shaft that stands: its zero is none."""
_NO_SHAFT_RAD_S = 30_000 / RPM_PER_RAD_S  # far beyond any crank
_STEADY_SHARE = 0.10  # what a turn's mean may differ from the latest, with an uneven turn, and still count
_OVERDUE = 1.25
"""Intervals without a mark from which on a marker cannot say whether the shaft still turns."""
_MOST_MARKS = 4096  # over a minute at 3000 rpm
_MISSED = f"more than {MOST_MISSING} marks in a row are missing: the marker is off, or the shaft stands"


@dataclass(frozen=True, slots=True)
class SpeedReading:
    """What a channel shows: the speed in rad/s (NaN: not at this moment), and whether it can be relied on.

    `lost` says in words why the shaft cannot be followed any more, in the block where that came to light.
    """

    speed_rad_s: float = math.nan
    valid: bool = False
    lost: str = ""


class ShaftSpeed:
    """Speed of the shaft by one channel of the card, taken in the acquisition thread, asked for in any.

    `channel` is the one that it comes from, None where no channel of the card shows the shaft.
    """

    def __init__(self, channels: Sequence[Channel], sample_rate: float, clock: Clock) -> None:
        self.channel, self._reading = shaft_reading(channels, sample_rate)
        self._clock = clock
        self.shown, self._at_s = SpeedReading(), -math.inf  # set in the acquisition thread, monotonic s

    @property
    def marks(self) -> NDArray[np.float64]:
        """The latest passages of crank angle zero that were seen, in samples since the start; shape (m,)."""
        return np.array(self._reading.marks if self._reading else (), np.float64)

    def take(self, first_sample: int, values: NDArray[np.float64]) -> None:
        if self._reading is not None:
            self.shown, self._at_s = self._reading.take(first_sample, values), self._clock.monotonic_s()

    def rpm(self) -> float:
        """Speed in rpm: of the last whole turn where that is steady; NaN where nothing recent shows it."""
        if self._clock.monotonic_s() - self._at_s > STALE_S:
            return math.nan
        return self.shown.speed_rad_s * RPM_PER_RAD_S


class Tachometer:
    """The mean of a card's last block by a tachometer on the shaft; taken and asked for like `ShaftSpeed`.

    A counter keeps what it timed last: where no pulse has come for longer than two should take, and a shaft
    that stands sends none, it shows nothing any more.
    """

    def __init__(self, channels: Iterable[Channel], clock: Clock) -> None:
        found = next((each for each in channels if shows_speed(each.name)), None)
        self.channel = None if found is None else found.name
        self._rad_per_pulse = found.scale if found is not None and found.raw_unit == "Hz" else None
        self._clock = clock
        self._rpm, self._at_s = math.nan, -math.inf
        self._last, self._changed_s = math.nan, -math.inf

    def take(self, values: NDArray[np.float64]) -> None:
        if len(values):
            self._rpm, self._at_s = float(values.mean()) * RPM_PER_RAD_S, self._clock.monotonic_s()
            if not np.all(values == self._last):
                self._changed_s = self._at_s
            self._last = float(values[-1])

    def rpm(self) -> float:
        stale = self._clock.monotonic_s() - self._at_s > STALE_S
        return math.nan if stale or abs(self._rpm) < STANDS_RPM or self._overdue else self._rpm

    @property
    def _overdue(self) -> bool:
        if self._rad_per_pulse is None:
            return False
        two_pulses_s = 2 * abs(self._rad_per_pulse) / max(abs(self._last), 1e-9)
        return self._clock.monotonic_s() - self._changed_s > STALE_S + two_pulses_s


class ByAngle:
    """From an unwrapped angle: the mean of the last turn, of the last tenth of a second where they differ.

    `count_rad`: a step of the angle. A tenth of a second may show two more or fewer, which is no difference.
    Where the angle leaps as no shaft turns, its counter was set at the index: it begins anew.
    """

    def __init__(self, sample_rate: float, count_rad: float = 0.0) -> None:
        self._rate = sample_rate
        self._alike_rad_s = 2.0 * count_rad / _LATEST_S
        self._leap_rad = max(_NO_SHAFT_RAD_S / sample_rate, 2.0 * count_rad)
        self._every = max(1, round(_POINT_S * sample_rate))
        self._points: deque[tuple[float, float]] = deque(maxlen=round(_KEPT_S / _POINT_S))
        self._last: float | None = None
        self._last_at = 0
        self.marks: deque[float] = deque(maxlen=_MOST_MARKS)

    def take(self, first_sample: int, values: NDArray[np.float64]) -> SpeedReading:
        """Take the next samples, shape (n,); those that a hole left out are passed over at an even speed."""
        if not len(values) or not np.isfinite(values).all():
            self._last = None
            return SpeedReading()
        # where the angle passes whole turns, between two samples where it does so evenly
        known = values if self._last is None else np.concatenate([[self._last], values])
        begin = first_sample - (self._last is not None)
        passed = np.ones(len(known) - 1)
        passed[: first_sample - begin] = first_sample - self._last_at
        leaps = np.flatnonzero(np.abs(np.diff(known)) > self._leap_rad * passed)
        if len(leaps):
            behind = int(begin + leaps[-1] + 1 - first_sample)
            self._points.clear()
            self._last = None
            return self.take(first_sample + behind, values[behind:])
        turns = np.floor(known / math.tau)
        for edge in np.flatnonzero(turns[1:] > turns[:-1]):
            share = (turns[edge + 1] * math.tau - known[edge]) / (known[edge + 1] - known[edge])
            self.marks.append(float(begin + edge + share))
        self._last, self._last_at = float(values[-1]), first_sample + len(values) - 1
        at = np.arange(len(values) - 1, -1, -self._every)[::-1]
        times = ((first_sample + at) / self._rate).tolist()
        self._points.extend(zip(times, values[at].tolist(), strict=True))
        # a turn is kept, and what of a slower one is less than `_LATEST_S` old
        points, (time_s, angle) = self._points, self._points[-1]
        while len(points) > 1 and points[1][0] < time_s - _LATEST_S and abs(angle - points[1][1]) >= math.tau:
            points.popleft()
        return SpeedReading(self._speed(), valid=True)

    def _speed(self) -> float:
        time, angle = (np.array(column) for column in zip(*self._points, strict=True))
        start = max(float(time[0]), float(time[-1]) - _LATEST_S)
        if start >= time[-1]:
            return math.nan
        latest = float((angle[-1] - np.interp(start, time, angle)) / (time[-1] - start))
        turned = np.abs(angle[-1] - angle)
        a_turn_ago = np.flatnonzero(turned >= math.tau)
        if not len(a_turn_ago):
            return latest
        low = int(a_turn_ago[-1])
        share = (turned[low] - math.tau) / (turned[low] - turned[low + 1])
        turn = math.copysign(math.tau, latest) / (time[-1] - time[low] - share * (time[low + 1] - time[low]))
        steady = abs(turn - latest) <= _STEADY_SHARE * abs(turn) + self._alike_rad_s
        return float(turn) if steady else latest


class _ByMarker:
    """From a once-per-revolution mark: the last revolution, for as long as the next mark is not overdue."""

    def __init__(self, sample_rate: float) -> None:
        self._rate = sample_rate
        self._tracker = MarkTracker()
        self._last = -math.inf
        self.marks: deque[float] = deque(maxlen=_MOST_MARKS)

    def take(self, first_sample: int, values: NDArray[np.float64]) -> SpeedReading:
        marks, changes = self._tracker.track(values)
        if len(marks):
            self._last = float(marks.position[-1])
        self.marks.extend(marks.position[~marks.interpolated].tolist())
        # one that is found at another speed at once has missed no marks
        found = {change.position for change in changes if change.valid}
        missed = any(not change.valid and change.position not in found for change in changes)
        lost = _MISSED if missed else ""
        interval = self._tracker.samples_per_turn
        if interval is None:
            return SpeedReading(lost=lost)
        overdue = first_sample + len(values) - self._last > _OVERDUE * interval
        return SpeedReading(math.nan if overdue else math.tau * self._rate / interval, valid=True, lost=lost)


def shaft_reading(
    channels: Iterable[Channel], sample_rate: float
) -> tuple[str | None, ByAngle | _ByMarker | None]:
    """The channel that shows the shaft best, and how it does; None where none of them shows it.

    Either takes samples without a hole; its `marks` are passages of crank angle zero, in samples since the
    start.
    """
    by_name = {channel.name: channel for channel in channels}
    name = shaft_channel(by_name)
    if name is None:
        return None, None
    if shows_marks(name):
        return name, _ByMarker(sample_rate)
    counts = by_name[name].scale if by_name[name].raw_unit == "count" else None
    return name, ByAngle(sample_rate, counts or 0.0)
