"""What ends a run by itself: a limit that is passed, a driven crank that does not turn as it should."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.angle.marker import MOST_MISSING
from daq.block import BLIND, Flag
from daq.channel import Channel
from daq.clock import Clock
from daq.errors import InterlockTripped
from daq.log.records import Event
from rig.files.scenario import Limit
from rig.session.shaft_speed import RPM_PER_RAD_S, SpeedReading

HUNG_S = 0.6
"""After which a part of a run that should look every 0.02 s, and looked at nothing, is taken for dead."""


@dataclass(frozen=True, slots=True)
class Passed:
    """A limit that was passed: `abort` or only a warning; `value` and `level` in the channel's unit."""

    channel: str
    unit: str
    value: float
    level: float
    abort: bool

    def __str__(self) -> str:
        if math.isnan(self.value):
            return f"{self.channel} is overloaded, open or not finite: its limit cannot be watched"
        what = "limit" if self.abort else "warning at"
        return f"{self.channel} = {self.value:.4g} {self.unit}, {what} {self.level:.4g} {self.unit}"


class LimitWatch:
    """Checks each channel's absolute value against its limits.

    A level counts as passed once the value has been beyond it for `hold` s without a break; each is told once
    until the channel has stayed below it for a whole block.
    """

    def __init__(self, limits: Sequence[Limit], sample_rate: float) -> None:
        self._limits = tuple(limits)
        self._hold = {limit.channel: max(1, round(limit.hold * sample_rate)) for limit in limits}
        self._beyond: dict[tuple[str, bool], int] = {}  # samples beyond without a break, up to now
        self._told: set[tuple[str, bool]] = set()

    def check(
        self, rows: Mapping[str, NDArray[np.floating]], flags: Mapping[str, Flag] | None = None
    ) -> list[Passed]:
        """Check the next samples, one row (n,) a channel; return what has been passed newly.

        A channel that `flags` marks as overloaded, open or not finite cannot be watched: with an abort level
        it counts as passed at once.
        """
        found: list[Passed] = []
        for limit in self._limits:
            if limit.abort is not None and flags and flags[limit.channel] & BLIND:
                found.append(Passed(limit.channel, limit.unit, math.nan, limit.abort, abort=True))
                continue
            values = np.abs(rows[limit.channel])  # NaN is beyond nothing: flags tell of it
            for level, abort in ((limit.warning, False), (limit.abort, True)):
                if level is not None and self._held(limit, values, level, abort):
                    found.append(Passed(limit.channel, limit.unit, float(np.nanmax(values)), level, abort))
        news = [passed for passed in found if (passed.channel, passed.abort) not in self._told]
        self._told |= {(passed.channel, passed.abort) for passed in found}
        return news

    def _held(self, limit: Limit, values: NDArray[np.floating], level: float, abort: bool) -> bool:
        beyond = values > level
        before = self._beyond.get((limit.channel, abort), 0)
        inside = np.flatnonzero(~beyond)
        longest = before + len(beyond)
        if len(inside):
            runs = np.diff(np.concatenate(([-1 - before], inside, [len(beyond)]))) - 1
            if inside[0] == 0:
                runs[0] = 0  # it ended with the last block, which has told of it
            longest = int(runs.max())
            before = -int(inside[-1]) - 1
        self._beyond[limit.channel, abort] = before + len(beyond)
        if not (beyond.any() or abort):  # a limit that stops is one cause, however often it is passed
            self._told.discard((limit.channel, abort))
        return longest >= self._hold[limit.channel]


_FREQUENCY_BLOCKS = 10  # a second of the card's readings
_OVER_S = 0.2  # two readings of the card; a whole cycle where that is longer
_DRIVEN_HZ, _LATELY_S = 500.0, 1.0
"""Below which a shaker drives, besides five times its own frequency; how long that is looked over at most."""
_ALL = 0.02
BEYOND_BENCH, _BEYOND_ORDER, _FAINT = 1.1, 1.5, 0.01
"""What sensors and amplifiers may differ by; a force below 1 % of what the bench allows endangers nothing."""
_DEAD = 1 / 3
"""Of what an order shows: a sensor that shows less on the way up would not show too much either."""
_GONE, _GONE_S = 0.05, 1.0
"""The same of one that drives steadily, where a resonance may take much of its force; and for how long:
whoever asks the source says first what became of it."""


class ForceWatch:
    """Holds the measured drive to `highest` and to what was ordered, in its unit.

    The drive is its sine at `frequency_hz`, its mean, and all else below 500 Hz (or five times that), as a
    mains hum or another frequency that a person sets. Of a sine of the coil the channel shows `shown`: less,
    where a gauge in the stinger measures it, which feels the impacts besides.

    It looks over whole cycles, `over_s` long, also of the `slowest_hz` that it comes through. A sensor that
    is blind for as long, or for more than a third of the time, is as bad as too much: what it clips may be
    any force. `take` is for the acquisition thread. `amplitude` is the sine's, `other` that of a sine as
    strong as all else, `frequency_hz` what the sine is seen to have over the last second, NaN until then.
    Where nothing is `driven`, as by an emulated source beside a real card, no force is too little.
    """

    def __init__(
        self,
        channel: Channel,
        frequency_hz: float,
        sample_rate: float,
        highest: float,
        shown: Callable[[float], float] = float,
        slowest_hz: float = math.inf,
        driven: bool = True,
    ) -> None:
        self.channel, self.highest, self.shown, self._driven = channel, highest, shown, driven
        self._nominal_hz, self._rate = frequency_hz, sample_rate
        cycles = math.floor(_OVER_S * frequency_hz + 1e-9), math.ceil(frequency_hz / slowest_hz - 1e-9)
        self.over_s = max(1, *cycles) / frequency_hz
        at_s = np.arange(round(self.over_s * sample_rate)) / sample_rate
        self._turning = np.exp(-2j * np.pi * frequency_hz * at_s)
        self._values = np.zeros(len(at_s))
        self._lately = min(len(at_s), round(_LATELY_S * sample_rate))
        self._lines = int(max(_DRIVEN_HZ, 5 * frequency_hz) * self._lately / sample_rate) + 1
        self.amplitude = self.other = self._mean = self._blind = 0.0
        self._beyond = False
        self._taken = self._sound = 0  # samples; those since it was blind
        self._held: tuple[float, float] | None = None  # amplitude, from a sample on
        self._gone = 0  # samples for which next to nothing of it shows
        self.frequency_hz = math.nan
        self._phasor = 0j
        self._advances = deque[tuple[float, int]](maxlen=_FREQUENCY_BLOCKS)  # rad too far, samples

    @property
    def strength(self) -> float:
        """Of a sine as strong as all that moves."""
        return math.hypot(self.amplitude, self.other)

    @property
    def shows(self) -> bool:
        """Whether the sensor has shown all that is looked over."""
        return self._sound >= len(self._values)

    def take(self, values: NDArray[np.floating], flags: Flag = Flag.GOOD) -> str:
        """Take the next samples, shape (n,), and what is said of them; what is wrong, newly."""
        self._taken += len(values)
        self._sound = 0 if flags & BLIND else self._sound + len(values)
        blind, count = self._blind, len(self._values)
        more = len(values) if flags & BLIND else -len(values) / 2
        self._blind = min(max(blind + more, 0.0), count)
        if blind < count <= self._blind:
            what = f"{self.channel.name} is overloaded, open or not finite for {self.over_s:g} s"
            return f"{what}: the force that the bench allows cannot be watched"
        self._values = np.concatenate((self._values, np.where(np.isfinite(values), values, 0.0)))[-count:]
        self._mean = float(self._values.mean())
        phasor = complex((self._values - self._mean) @ self._turning) * 2 / count
        self._follow(phasor, len(values))
        sine = (phasor * self._turning[-self._lately :].conj()).real
        self.other = self._strength_of(self._values[-self._lately :] - self._mean - sine)
        return self._beyond_bench() or self._beyond_order(len(values))

    def _strength_of(self, values: NDArray[np.floating]) -> float:
        lines = np.abs(np.fft.rfft(values)[: self._lines]) ** 2
        return 2 * math.sqrt(float(lines.sum() - lines[0] / 2)) / len(values)

    def _beyond_bench(self) -> str:
        of_sine, of_all = self.amplitude + abs(self._mean), math.hypot(self.strength, self._mean)
        of_drive = self.shown(self.highest)
        before, self._beyond = (
            self._beyond,
            (of_sine > BEYOND_BENCH * of_drive or of_all > BEYOND_BENCH * max(self.highest, of_drive)),
        )
        if before or not self._beyond:  # told once, as it passes
            return ""
        unit = self.channel.unit
        other = f", {self.other:.3g} of it not at {self._nominal_hz:g} Hz" if self.other > of_sine else ""
        shows = f"{self.channel.name} = {max(of_sine, of_all):.4g} {unit}{other}"
        return f"{shows}, where the bench allows {self.highest:g} {unit}{self.of_which(self.highest)}"

    def hold(self, ordered: float, from_sample: float) -> None:
        """Hold the sine from that sample on (`take`'s first is 0) to this amplitude, N. For any thread.

        Half as much again is too much; next to nothing for a second, too little. Not its mean: of an offset a
        sensor with a corner may show anything on its way.
        """
        self._held = ordered, from_sample

    def let_go(self) -> None:
        """Hold it to no order: another is given. For any thread."""
        self._held = None

    def _beyond_order(self, count: int) -> str:
        held = self._held
        if held is None or self._taken - len(self._values) < held[1]:
            self._gone = 0
            return ""
        shown, faint = self.shown(held[0]), _FAINT * self.highest
        gone = self._driven and self.amplitude < _GONE * shown - faint
        self._gone = self._gone + count if gone else 0
        # a gauge feels the impacts, which may hold what drives as firmly as it pushes
        much = self.amplitude > _BEYOND_ORDER * max(shown, held[0]) + faint
        if not much and self._gone < _GONE_S * self._rate:
            return ""
        self._held = None  # told once
        return self._unlike_order(self.amplitude, held[0], 0.0, much)

    def of_which(self, force: float) -> str:
        """How much of a force the channel shows, in words; nothing where it shows all of it."""
        shown = self.shown(force)
        unit = self.channel.unit
        return "" if abs(shown - force) <= _ALL * force else f", of which it is to show {shown:.3g} {unit}"

    def _follow(self, phasor: complex, count: int) -> None:
        """By how much the sine turns between two looks more than it should."""
        nominal = np.exp(2j * np.pi * self._nominal_hz * count / self._rate)
        self._advances.append((float(np.angle(phasor * np.conj(self._phasor * nominal))), count))
        self._phasor, self.amplitude = phasor, abs(phasor)
        turned, samples = (sum(column) for column in zip(*self._advances, strict=True))
        whole = len(self._advances) == self._advances.maxlen
        off_hz = turned * self._rate / (2 * np.pi * samples) if whole and samples else math.nan
        self.frequency_hz = self._nominal_hz + off_hz

    def unlike(self, ordered: float, offset: float, frequency_hz: float) -> str:
        """How the force is not what was ordered, N, by far, and what to look at; empty where it is.

        A sensor may show nothing of an `offset`.
        """
        if self._blind >= len(self._values) / 2:
            return f"{self.channel.name} shows no number"
        at_s = np.arange(len(self._values)) / self._rate
        turning = np.exp(2j * np.pi * frequency_hz * at_s)
        told = np.column_stack([turning.real, turning.imag, np.ones(len(at_s))])
        (real, imaginary, mean), *_ = np.linalg.lstsq(told, self._values, rcond=None)
        sine = math.hypot(real, imaginary)
        force = sine + abs(float(mean))
        shown, faint = self.shown(ordered), _FAINT * self.highest
        much = force > _BEYOND_ORDER * (shown + abs(offset)) + faint
        if much or (self._driven and sine < _DEAD * shown - faint):
            return self._unlike_order(force, ordered, offset, much)
        return ""

    def _unlike_order(self, force: float, ordered: float, offset: float, much: bool) -> str:
        check = "what a volt makes in the bench file (force_per_volt), the amplifier's gain"
        if not much:
            check = "the sensor and its cable, without which nothing guards the bench; the amplifier"
        shows = f"{self.channel.name} = {force:.3g} {self.channel.unit}"
        beside = f" about {offset:.3g}" if offset else ""
        return f"{shows} where {ordered:.3g}{beside} is ordered{self.of_which(ordered)}: {check}"


BACK_S = 0.15
"""How long it must be gone to count as over: three readings of the card in a row show it gone."""


class Debounced:
    """Tells whether something has held for `hold_s`.

    It is over once it has been gone for 0.15 s, or once readings of which none showed it have lasted for
    `hold_s`. So a wrong reading now and then proves nothing, and a value that chatters about a limit does not
    begin anew each time. All times are of one clock, whichever.
    """

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self.since_s: float | None = None
        """Since when it holds, be it for how short; None while it does not."""
        self._gone_s: float | None = None
        self._latest_s, self._lapsed = -math.inf, False

    def look(self, at_s: float, *, holds: bool, gone: bool) -> float | None:
        """Take a reading; how long it has held, in s, once that is `hold_s`, else None.

        A reading may be neither: within the hysteresis, or no value at all.
        """
        self._lapsed |= not holds
        if self._lapsed and at_s - self._latest_s >= self._hold_s:
            self.since_s = None
        if holds:
            self._gone_s, self._latest_s, self._lapsed = None, at_s, False
            self.since_s = at_s if self.since_s is None else self.since_s
            held_s = at_s - self.since_s
            return held_s if held_s >= self._hold_s else None
        if gone:
            self._gone_s = at_s if self._gone_s is None else self._gone_s
            if at_s - self._gone_s >= BACK_S:
                self.since_s = None
        return None


OVERSPEED_S = 0.3
"""For how long it has to, besides a turn: a glitch on a marker shows any speed until the next mark."""
OFF_SHARE, OFF_S = 0.05, 0.5
"""A turn's mean off by more than a healthy drive's ever is, and for how long before the run ends."""
BACK_SHARE = 0.04
"""How near a speed that has been off must come to count as back."""
UNKNOWN_S = 1.0
"""How long a run goes on after its instrument has said that it knows nothing of the speed. A marker says so,
and has lost the shaft, after four and a half turns without a mark."""
SPEED_GUARDED = (
    f"shaft within {OFF_SHARE:.0%} of its speed: the run ends {OFF_S:g} s after it has left it, "
    f"{UNKNOWN_S:g} s after no instrument shows it; where a marker alone does, once more than {MOST_MISSING} "
    "marks in a row are missing"
)
"""What a person should know of it before anything moves."""


def guards_of_shaft(clock: Clock, highest_rad_s: float = math.inf) -> tuple[SpeedGuard, SpeedGuard]:
    """One that looks at what the card shows of the shaft, one at what an encoder on a bus does."""
    shows, shows_not = "encoder shows", "the encoder shows no speed"
    return SpeedGuard(clock, highest_rad_s=highest_rad_s), SpeedGuard(clock, shows, shows_not, highest_rad_s)


class SpeedGuard:
    """Looks at every block in the acquisition thread.

    Whatever is wanted, a tenth more than `highest_rad_s` for 0.3 s and a turn has tripped it: a glitch on a
    marker shows any speed until the next mark. All else it does between `arm` and `disarm`.

    A speed that leaves the wanted one by more than 5 %, either way, is an event at once and `tripped` after
    half a second; one that no instrument shows is an event at once and `tripped` after a second, and at once
    where its instrument says that it has lost the shaft. Either is over after 0.15 s within 4 %, or seen; and
    a speed between 4 % and 5 % off, or overdue, is off no more after half a second of it: one wrong reading,
    as a glitch on a marker makes it, stops nothing, and a speed that chatters about the limit does. All times
    are those of the instrument that shows it; readings come every 0.075 s, so that a shaft that runs away has
    tripped it 0.6 s after that is shown, at the latest.
    `shows` and `shows_not` say in words which instrument it is.
    """

    def __init__(
        self,
        clock: Clock,
        shows: str = "shaft at",
        shows_not: str = "no instrument shows the shaft's speed",
        highest_rad_s: float = math.inf,
    ) -> None:
        self._clock, self._shows, self._shows_not = clock, shows, shows_not
        self._highest_rad_s = highest_rad_s
        self._beyond = Debounced(OVERSPEED_S + math.tau / highest_rad_s)
        self._lock = threading.Lock()  # sequence, acquisition and guard all come here
        self._wanted_rad_s: float | None = None
        self._off, self._unknown = Debounced(OFF_S), Debounced(UNKNOWN_S)
        self.tripped: str | None = None

    def arm(self, wanted_rad_s: float) -> None:
        """Hold the shaft to a speed from now on."""
        with self._lock:
            self._off, self._unknown = Debounced(OFF_S), Debounced(UNKNOWN_S)  # what was before is over
            self._wanted_rad_s = wanted_rad_s

    @property
    def armed(self) -> bool:
        return self._wanted_rad_s is not None

    def disarm(self) -> None:
        """Let it do what it likes: the drive is about to change its speed. Waits for nobody."""
        self._wanted_rad_s = None

    def check(self) -> None:
        if self.tripped is not None:
            raise InterlockTripped(f"interlock: {self.tripped}")

    def look(self, shown: SpeedReading, card_s: float) -> list[Event]:
        """Judge what a block that ends at `card_s`, by any even clock, showed; what to tell of it."""
        with self._lock:
            wanted, rpm = self._wanted_rad_s, shown.speed_rad_s * RPM_PER_RAD_S
            highest_rpm = self._highest_rad_s * RPM_PER_RAD_S
            beyond = f"{self._shows} {rpm:.4g} rpm, where the bench allows {highest_rpm:.4g} rpm"
            held, limit_rpm = self._beyond, BEYOND_BENCH * highest_rpm
            told = self._judge("beyond", held, card_s, abs(rpm) > limit_rpm, abs(rpm) <= highest_rpm, beyond)
            if wanted is not None:
                apart = abs(shown.speed_rad_s - wanted) / wanted if shown.valid else math.nan
                off = f"{self._shows} {rpm:.4g} rpm, wanted {wanted * RPM_PER_RAD_S:.4g} rpm"
                blind = not shown.valid
                told += [
                    *self._trip(shown.lost),
                    *self._judge("unknown", self._unknown, card_s, blind, not blind, self._shows_not),
                    *self._judge("off", self._off, card_s, apart > OFF_SHARE, apart <= BACK_SHARE, off),
                ]
        return [Event(self._clock.unix_ns(), level, "acquisition", code, text) for level, code, text in told]

    def _judge(
        self, what: str, held: Debounced, card_s: float, holds: bool, gone: bool, text: str
    ) -> list[tuple[str, str, str]]:
        known_s = held.since_s
        lasted_s = held.look(card_s, holds=holds, gone=gone)
        news = [("warning", f"speed.{what}", text)] if held.since_s not in (None, known_s) else []
        return news if lasted_s is None else [*news, *self._trip(f"{text} for {lasted_s:.1f} s")]

    def _trip(self, why: str) -> list[tuple[str, str, str]]:
        if not why or self.tripped is not None:
            return []
        self.tripped = why
        return [("error", "speed.abort", why)]
