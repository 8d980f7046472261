"""Whether a driven crank turns as it should: no belt that slips, no sensor that came off."""

from __future__ import annotations

import math
import threading

from daq.angle.marker import MOST_MISSING
from daq.clock import Clock
from daq.errors import InterlockTripped
from daq.log.records import Event
from rig.session.debounce import Debounced
from rig.session.shaft_speed import SpeedReading

_RPM_PER_RAD_S = 60.0 / math.tau
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


def guards_of_shaft(clock: Clock) -> tuple[SpeedGuard, SpeedGuard]:
    """One that looks at what the card shows of the shaft, one at what an encoder on a bus does."""
    return SpeedGuard(clock), SpeedGuard(clock, "encoder shows", "the encoder shows no speed")


class SpeedGuard:
    """Looks at every block in the acquisition thread, between `arm` and `disarm`.

    A speed that leaves the wanted one by more than 5 %, either way, is an event at once and `tripped` after
    half a second; one that no instrument shows is an event at once and `tripped` after a second, and at once
    where its instrument says that it has lost the shaft. Either is over after 0.15 s within 4 %, or seen; and
    a speed between 4 % and 5 % off, or overdue, is off no more after half a second of it: one wrong reading,
    as a glitch on a marker makes it, stops nothing, and a speed that chatters about the limit does. All times
    are those of the instrument that shows it; readings come every 0.1 s, so that a shaft that runs away has
    tripped it 0.6 s after that is shown, at the latest.
    `shows` and `shows_not` say in words which instrument it is.
    """

    def __init__(
        self, clock: Clock, shows: str = "shaft at", shows_not: str = "no instrument shows the shaft's speed"
    ) -> None:
        self._clock, self._shows, self._shows_not = clock, shows, shows_not
        self._lock = threading.Lock()
        self._wanted_rad_s: float | None = None
        self._off, self._unknown = Debounced(OFF_S), Debounced(UNKNOWN_S)
        self.tripped: str | None = None

    def arm(self, wanted_rad_s: float) -> None:
        """Hold the shaft to a speed from now on."""
        with self._lock:
            self._off, self._unknown = Debounced(OFF_S), Debounced(UNKNOWN_S)
            self._wanted_rad_s = wanted_rad_s

    @property
    def armed(self) -> bool:
        """Whether it holds the shaft to a speed."""
        return self._wanted_rad_s is not None

    def disarm(self) -> None:
        """Let it do what it likes: the drive is about to change its speed."""
        with self._lock:
            self._wanted_rad_s = None

    def check(self) -> None:
        """Raise InterlockTripped once it has tripped."""
        if self.tripped is not None:
            raise InterlockTripped(f"interlock: {self.tripped}; the motor is off")

    def look(self, shown: SpeedReading, card_s: float) -> list[Event]:
        """Judge what a block that ends at `card_s`, by any even clock, showed; what to tell of it."""
        with self._lock:
            wanted = self._wanted_rad_s
            if wanted is None:
                return []
            apart = abs(shown.speed_rad_s - wanted) / wanted if shown.valid else math.nan
            rpm, wanted_rpm = shown.speed_rad_s * _RPM_PER_RAD_S, wanted * _RPM_PER_RAD_S
            off = f"{self._shows} {rpm:.4g} rpm, wanted {wanted_rpm:.4g} rpm"
            told = [
                *self._trip(shown.lost),
                *self._judge("unknown", self._unknown, card_s, not shown.valid, shown.valid, self._shows_not),
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
