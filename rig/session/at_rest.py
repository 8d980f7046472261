"""Sensors while nothing is driven: what each shows, and what a hand does to them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from daq.angle.marker import HIGH_V, LOW_V, RisingEdges
from daq.block import Flag
from daq.channel import Channel
from daq.signals.at_rest import AtRest, Line, Tap, TapFinder, at_rest
from drivers.ni_daq.channels import CardChannel
from drivers.protocols.card import CardReading
from rig.pages.words import as_written, counted, estimate

Array = NDArray[np.float64]

WINDOW_S: Final = 1.0
_WINDOWS, _DRIFT_WINDOWS = 10, 30
_LEAST_TAP: Final = 1e-4
"""Of a channel's range: less may be a converter's last bits."""
_SURE: Final = 3.0
_TRAIL_S: Final = 1e-3
"""Between two angles that are kept: a shaft that a hand turns passes half a degree in it."""
TURNING_RAD: Final = math.radians(5.0)
_STILL_S: Final = 0.7
_STANDS_RAD: Final = math.radians(0.5)
"""Within which an encoder on a bus may flicker."""
_LONGEST_TURN: Final = 8192
"""Readings of one that are kept, some ten minutes: what is turned for longer is told from there on."""
_NO_MARK_S: Final = 2.0
"""After the last mark a shaft that nothing else shows is taken to stand."""
_FLAGS: Final = {
    Flag.OVERLOAD: "overload",
    Flag.OPEN_SENSOR: "open sensor",
    Flag.NOT_FINITE: "no number",
    Flag.CLOCK_NOT_LOCKED: "clock not locked",
}


@dataclass(frozen=True, slots=True)
class Shown:
    """What a channel shows, in its `unit`; NaN what is not known, or means nothing on a counter or a marker.

    `least` and `most` are of the newest reading, `level` and `noise` of a second, `drift` a minute. `state`
    says what is wrong, `sheet` what the sensor says of itself.
    """

    name: str
    physical: str
    unit: str
    range: float
    least: float
    most: float
    level: float = math.nan
    noise: float = math.nan
    lines: tuple[Line, ...] = ()
    drift: float = math.nan
    state: str = ""
    sheet: str = ""

    @property
    def words(self) -> dict[str, str]:
        """Each of them as people read it; empty what is not known."""
        factor, unit = as_written(self.unit)
        angle = self.unit == "rad"

        def told(value: float, per: str = "") -> str:
            if not math.isfinite(value):
                return ""
            return f"{math.degrees(value):.1f}°" if angle else f"{estimate(factor * value, unit)}{per}"

        level = told(self.level if math.isfinite(self.level) else self.most)
        if math.isfinite(self.noise) and self.noise > 0 and math.isfinite(self.level):
            digits = max(0, 1 - math.floor(math.log10(factor * self.noise)))  # no more than noise leaves
            level = f"{round(factor * self.level, digits) + 0.0:.{digits}f} {unit}"
        hum = sorted(self.lines, key=lambda line: -line.amplitude)[:3]
        return {
            "level": level,
            "noise": told(self.noise),
            "mains": ", ".join(f"{line.frequency_hz:.0f} Hz {told(line.amplitude)}" for line in hum),
            "drift": told(self.drift, "/min"),
        }


class _Row:
    """What is remembered of one analog channel."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._windows: deque[AtRest] = deque(maxlen=_WINDOWS)
        self._means: deque[float] = deque(maxlen=_DRIFT_WINDOWS)

    def take(self, values: Array) -> None:
        found = at_rest(values, self._rate)
        self._windows.append(found)
        self._means.append(found.mean)

    def shown(self) -> dict[str, object]:
        if not self._windows:
            return {}
        noise = np.array([each.noise for each in self._windows])
        quietest = self._windows[int(np.argmin(np.where(np.isfinite(noise), noise, np.inf)))]
        return {
            "level": self._means[-1],
            "noise": float(np.median(noise)),  # taps are in few of them
            "lines": quietest.lines,
            "drift": _drift_a_minute(np.array(self._means)),
        }


def _drift_a_minute(means: Array) -> float:
    """By a line through the means of windows; NaN where none stands out of their scatter."""
    if len(means) < _WINDOWS or not np.isfinite(means).all():
        return math.nan
    at = np.arange(len(means)) - (len(means) - 1) / 2
    slope = float(at @ means / (at @ at))
    left = means - means.mean() - slope * at
    doubt = math.sqrt(float(left @ left) / (len(means) - 2) / float(at @ at))
    return slope * 60.0 / WINDOW_S if abs(slope) > _SURE * doubt else math.nan


@dataclass(frozen=True, slots=True)
class Turn:
    """What a turn by hand showed: by how much each encoder turned (rad, unwrapped, as it is read), what each
    read last, and at every mark; how large a part of the turn a marker was high, NaN for one on a counter;
    how many `marks` came.
    """

    turned: Mapping[str, float]
    last: Mapping[str, float]
    at_marks: Mapping[str, Array]
    high: float = math.nan
    marks: int = 0

    def __str__(self) -> str:
        if not self.turned:
            return f"{counted(self.marks, 'mark')}; no encoder shows an angle"
        told = [f"{name} turned by {math.degrees(by):+.0f}°" for name, by in self.turned.items()]
        for name, angles in self.at_marks.items():
            if len(angles):
                where = math.degrees(angles[-1] % math.tau)
                told.append(f"{counted(len(angles), 'mark')}, the last at {where:.1f}° of {name}")
        return "; ".join(told)


_Trail: TypeAlias = deque[tuple[Array, Array]]
"""Times and angles of an encoder, piece by piece."""


class Shaft:
    """What encoders and a marker show of a shaft that is turned by hand."""

    def __init__(self, channels: Sequence[CardChannel], rate: float) -> None:
        self._rate, self._step = rate, max(1, round(_TRAIL_S * rate))
        self._angles = {row: each.name for row, each in enumerate(channels) if each.kind == "encoder"}
        self._marker = next((row for row, each in enumerate(channels) if each.kind == "marker"), None)
        on_counter = self._marker is not None and channels[self._marker].counted
        self._shares = self._marker is not None and not on_counter
        self._edges = RisingEdges()
        self._trails = {name: _Trail(maxlen=_LONGEST_TURN) for name in self._angles.values()}
        self._marks = deque[float](maxlen=_LONGEST_TURN)
        self.begin()

    @property
    def there(self) -> bool:
        """Whether there is anything that shows a shaft."""
        return bool(self._trails) or self._marker is not None

    @property
    def names(self) -> list[str]:
        return list(self._trails)

    def begin(self) -> None:
        """Forget what was turned so far, but where each encoder stands."""
        self._marks.clear()
        self._moved_s = -math.inf
        self._shown, self._since_mark = np.zeros(2), np.zeros(2)  # samples that were high, and all of them
        for trail in self._trails.values():
            if trail:
                times, angle = trail[-1]
                trail.clear()
                trail.append((times[-1:].copy(), angle[-1:].copy()))

    def take(self, reading: CardReading) -> None:
        first, count = reading.first_sample, reading.values.shape[1]
        times = (first + np.arange(count)) / self._rate
        moved = False
        for row, name in self._angles.items():
            angle, trail = reading.values[row], self._trails[name]
            turns = bool(np.ptp(angle) > 0)
            moved = moved or turns
            if turns or not trail or angle[0] != trail[-1][1][-1]:  # one that stands says nothing new
                trail.append((times[:: self._step].copy(), angle[:: self._step].copy()))
        if self._marker is not None:
            volts = reading.values[self._marker]
            edges = self._edges.find(volts)
            high = volts > (LOW_V + HIGH_V) / 2
            if moved:
                self._shown += int(np.count_nonzero(high)), count
            elif not self._angles:
                self._share(high, edges.position - first)
            self._marks += (edges.position / self._rate).tolist()
        if moved:
            self._moved_s = float(times[-1])

    def _share(self, high: NDArray[np.bool_], marks: Array) -> None:
        """Count from the first mark to the last, where nothing else shows when a shaft stands on its mark."""
        cuts = np.clip(np.ceil(marks).astype(int), 0, len(high))
        for number, part in enumerate(np.split(high, cuts)):
            if number:
                self._shown += self._since_mark
                self._since_mark = np.zeros(2)
            if number or self._marks:
                self._since_mark += int(np.count_nonzero(part)), len(part)

    def beside(self, name: str, times_s: Array, angle_rad: Array) -> None:
        """What an encoder on a bus has shown of late, on the card's time; it replaces what was there."""
        since = self._trails.get(name)
        begin_s = float(since[0][0][0]) if since else -math.inf
        later = times_s >= begin_s
        if later.any():
            self._trails[name] = _Trail([(times_s[later], angle_rad[later])])
            elsewhere = np.flatnonzero(np.abs(angle_rad - angle_rad[-1]) > _STANDS_RAD)
            if len(elsewhere):
                self._moved_s = max(self._moved_s, float(times_s[elsewhere[-1]]))

    @property
    def _last_mark_s(self) -> float:
        return self._marks[-1] if self._marks else -math.inf

    def turned(self) -> Turn:
        """Since it was begun."""
        trails = {name: _joined(each) for name, each in self._trails.items()}
        marks = np.array(self._marks)
        there = {name: each for name, each in trails.items() if len(each[0])}
        return Turn(
            {name: float(angle[-1] - angle[0]) for name, (_, angle) in there.items()},
            {name: float(angle[-1]) for name, (_, angle) in there.items()},
            {name: np.interp(marks, times, angle) for name, (times, angle) in there.items()},
            float(self._shown[0] / self._shown[1]) if self._shares and self._shown[1] else math.nan,
            len(marks),
        )

    def rested(self, now_s: float) -> Turn | None:
        """A turn that has come to its end by then, which begins the next; None while there is none."""
        moved_s, still_s = (self._moved_s, _STILL_S) if self._trails else (self._last_mark_s, _NO_MARK_S)
        if now_s - moved_s <= still_s:
            return None
        turn = self.turned()
        came = max((abs(by) for by in turn.turned.values()), default=0.0) >= TURNING_RAD
        if not (came if self._trails else self._marks):
            return None
        self.begin()
        return turn


def _joined(trail: _Trail) -> tuple[Array, Array]:
    times = [each for each, _ in trail] or [np.zeros(0)]
    return np.concatenate(times), np.concatenate([each for _, each in trail] or [np.zeros(0)])


class Sensors:
    """All channels of a card, from its readings in the order in which they come."""

    def __init__(
        self,
        channels: Sequence[CardChannel],
        described: Sequence[Channel],
        rate: float,
        sheets: Mapping[str, str],
    ) -> None:
        self.channels, self._rate, self._sheets = tuple(channels), rate, sheets
        self._described = tuple(described)
        self._analog = [row for row, each in enumerate(channels) if not each.counted and each.mark is None]
        self._analog = [row for row in self._analog if channels[row].kind != "marker"]
        self._rows = {row: _Row(rate) for row in self._analog}
        self._window: list[Array] = []
        self._taps = TapFinder(rate, np.array([channels[row].range * _LEAST_TAP for row in self._analog]))
        self.shaft = Shaft(channels, rate)
        self.beside: dict[str, tuple[str, float]] = {}
        """The newest value of what is measured beside the card, with its unit."""
        self._newest: CardReading | None = None
        self.trends = [deque[tuple[float, float]](maxlen=400) for _ in channels]

    @property
    def tappable(self) -> list[CardChannel]:
        """Those of a force or an acceleration."""
        return [self.channels[row] for row in self._analog if self.channels[row].unit in ("N", "m/s2")]

    @property
    def end_s(self) -> float:
        """Up to where readings have come, s since sample 0."""
        reading = self._newest
        return 0.0 if reading is None else (reading.first_sample + reading.values.shape[1]) / self._rate

    def take(self, reading: CardReading) -> Tap | None:
        """Take a reading; a tap that it has shown, by `swing`."""
        self._newest = reading
        for trend, values in zip(self.trends, reading.values, strict=True):
            trend.append((float(values.min()), float(values.max())))
        self.shaft.take(reading)
        analog = reading.values[self._analog]
        self._window.append(analog)
        if sum(each.shape[1] for each in self._window) >= (count := round(WINDOW_S * self._rate)):
            seen = np.concatenate(self._window, axis=1)
            self._window = [seen[:, count:]]
            for row, values in zip(self._analog, seen[:, :count], strict=True):
                self._rows[row].take(values)
        return self._taps.take(analog) if len(analog) else None

    def swing(self, tap: Tap, unit: str) -> tuple[CardChannel, float] | None:
        """Which channel of a unit has swung farthest, and how far, with the sign of its first swing."""
        swings = {
            row: swing
            for row, swing in zip(self._analog, tap.swings.tolist(), strict=True)
            if swing and self.channels[row].unit == unit
        }
        row = max(swings, key=lambda each: abs(swings[each]), default=None)
        return None if row is None else (self.channels[row], swings[row])

    def tapped(self, tap: Tap) -> str:
        """A tap in words: the farthest swing in each unit."""
        units = dict.fromkeys(self.channels[row].unit for row in self._analog)
        found = [swung for unit in units if (swung := self.swing(tap, unit))]
        told = []
        for channel, swing in found:
            factor, unit = as_written(channel.unit)
            told.append(f"{channel.name} {'+' if swing > 0 else ''}{estimate(factor * swing, unit)}")
        return ", ".join(told)

    def shown(self) -> list[Shown]:
        """What every channel shows now; nothing before the first reading."""
        reading = self._newest
        if reading is None:
            return []
        found = []
        for row, (channel, described) in enumerate(zip(self.channels, self._described, strict=True)):
            values = reading.values[row]
            serial = f"serial {described.serial}" if described.serial else ""
            more = self._rows[row].shown() if row in self._rows else {}
            found.append(
                Shown(
                    channel.name,
                    channel.physical,
                    channel.unit,
                    channel.largest if channel.mark is None else math.inf,
                    float(values.min()),
                    float(values[-1]) if channel.unit == "rad" else float(values.max()),
                    state=", ".join(word for flag, word in _FLAGS.items() if reading.flags[row] & flag),
                    sheet=self._sheets.get(channel.name, serial),
                    **more,  # type: ignore[arg-type]
                )
            )
        for name, (unit, value) in self.beside.items():
            found.append(Shown(name, "", unit, math.inf, value, value))
        return found
