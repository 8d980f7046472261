"""Whether a driven crank turns as it should: no belt that slips, no sensor that came off."""

from __future__ import annotations

import math
import threading

from daq.clock import Clock
from daq.errors import InterlockTripped
from daq.log.records import Event
from rig.session.shaft_speed import Shown

_RPM_PER_RAD_S = 60.0 / math.tau
OFF_SHARE, OFF_S = 0.05, 0.5
"""A turn's mean off by more than a healthy drive's ever is, and for how long before the run ends."""
UNKNOWN_S = 1.0
"""How long a run goes on blind. A marker has by then missed more than three marks in a row, besides."""
SPEED_GUARDED = (
    f"shaft within {OFF_SHARE:.0%} of its speed: the run ends {OFF_S:g} s after it has left it, "
    f"{UNKNOWN_S:g} s after no instrument shows it"
)
"""What a person should know of it before anything moves."""


def guards_of_shaft(clock: Clock) -> tuple[SpeedGuard, SpeedGuard]:
    """One that looks at what the card shows of the shaft, one at what an encoder on a bus does."""
    return SpeedGuard(clock), SpeedGuard(clock, "encoder shows", "the encoder shows no speed")


class SpeedGuard:
    """Looks at every block in the acquisition thread, between `arm` and `disarm`.

    A speed that leaves the wanted one by more than 5 % is an event at once and `tripped` after half a second;
    one that no instrument shows is an event at once and `tripped` after a second. Both times are those of
    the instrument that shows it; `shows` and `shows_not` say in words which that is.
    """

    def __init__(
        self, clock: Clock, shows: str = "shaft at", shows_not: str = "no instrument shows the shaft's speed"
    ) -> None:
        self._clock, self._shows, self._shows_not = clock, shows, shows_not
        self._lock = threading.Lock()
        self._wanted_rad_s: float | None = None
        self._since: dict[str, float] = {}
        self.tripped: str | None = None

    def arm(self, wanted_rad_s: float) -> None:
        """Hold the shaft to a speed from now on."""
        with self._lock:
            self._since.clear()
            self._wanted_rad_s = wanted_rad_s

    def disarm(self) -> None:
        """Let it do what it likes: the drive is about to change its speed."""
        with self._lock:
            self._wanted_rad_s = None

    def check(self) -> None:
        """Raise InterlockTripped once it has tripped."""
        if self.tripped is not None:
            raise InterlockTripped(f"interlock: {self.tripped}; the motor is off")

    def look(self, shown: Shown, card_s: float) -> list[Event]:
        """Judge what a block that ends at `card_s`, by any even clock, showed; what to tell of it."""
        with self._lock:
            wanted = self._wanted_rad_s
            if wanted is None:
                return []
            unknown = not shown.valid
            off = not unknown and abs(shown.speed_rad_s - wanted) > OFF_SHARE * wanted
            rpm, wanted_rpm = shown.speed_rad_s * _RPM_PER_RAD_S, wanted * _RPM_PER_RAD_S
            told = [
                *self._held("unknown", unknown, card_s, UNKNOWN_S, self._shows_not),
                *self._held(
                    "off", off, card_s, OFF_S, f"{self._shows} {rpm:.4g} rpm, wanted {wanted_rpm:.4g} rpm"
                ),
            ]
        return [Event(self._clock.unix_ns(), level, "acquisition", code, text) for level, code, text in told]

    def _held(
        self, what: str, holds: bool, card_s: float, longest_s: float, text: str
    ) -> list[tuple[str, str, str]]:
        if not holds:
            self._since.pop(what, None)
            return []
        news = [] if what in self._since else [("warning", f"speed.{what}", text)]
        since_s = self._since.setdefault(what, card_s)
        if card_s - since_s >= longest_s and self.tripped is None:
            self.tripped = f"{text} for {card_s - since_s:.1f} s"
            news.append(("error", "speed.abort", self.tripped))
        return news
