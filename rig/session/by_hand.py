"""What a person sets in a run: asked for, awaited, and believed when it is measured."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from daq.clock import Clock, SystemClock
from daq.errors import InstrumentRefused, InterlockTripped
from daq.log.records import ClockRecord
from daq.time_base.clocks import CardClock
from drivers.manual.actuator import REST, STOP, ManualActuator
from drivers.protocols.instrument import Notice
from rig.session.interlock import BEYOND_BENCH, HUNG_S, OVERSPEED_S, Debounced, ForceWatch
from rig.session.shaft_speed import RPM_PER_RAD_S, STANDS_RPM
from rig.twin.alignment import FREQUENCY_TOLERANCE
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.model import SineDrive

HELD_S = 1.0
"""For how long it has to be measured as it was asked for, before the run goes on."""
REST_S = 30.0
"""Within which a rig has to be seen at rest once a person was asked for that."""
_STEP_S, _TELL_S, _STANDS_S = 0.02, 2.0, 1.0
_SPEED_SHARE, _FORCE_SHARE, _FREQUENCY_SHARE = 0.02, 0.05, 0.8 * FREQUENCY_TOLERANCE
"""Of what was asked: what counts as set; the frequency within what the twin can follow."""
_FAINT = 0.02
_NEXT_MARK_S = 3.0
"""How long the next mark is awaited: a turn at 20 rpm."""


class Seen(Protocol):
    """How a drive that a person sets is asked for, and how it shows; for any thread."""

    def words(self, drive: Any) -> str:
        """What to set."""

    def order(self, drive: Any) -> tuple[float, ...]:
        """The same in SI, for an emulated person."""

    def shown(self) -> tuple[float, ...]:
        """What is measured of that now, NaN where nothing shows it."""

    def told(self) -> str:
        """What is measured, for a person."""

    def is_set(self, drive: Any) -> bool:
        """Whether it is measured as it was asked for."""

    @property
    def beyond(self) -> bool:
        """Whether it is more than the bench allows."""

    @property
    def rests(self) -> bool | None:
        """Whether nothing is seen of it; None where the same is seen of an instrument whose cable is off."""


@dataclass(frozen=True, slots=True)
class ShaftSeen:
    """A shaft, by the instruments on it; the bench allows `highest_rpm`."""

    measured_rpm: Callable[[], float]
    highest_rpm: float

    def words(self, drive: SpeedDrive) -> str:
        return f"turn the crank up to {drive.speed * RPM_PER_RAD_S:g} rpm and hold it there"

    def order(self, drive: SpeedDrive) -> tuple[float, ...]:
        return (drive.speed,)

    def shown(self) -> tuple[float, ...]:
        return (self.measured_rpm() / RPM_PER_RAD_S,)

    def told(self) -> str:
        rpm = self.measured_rpm()
        return "nothing shows that the shaft turns" if math.isnan(rpm) else f"{rpm:.4g} rpm"

    def is_set(self, drive: SpeedDrive) -> bool:
        return abs(self.shown()[0] - drive.speed) <= _SPEED_SHARE * drive.speed

    @property
    def beyond(self) -> bool:
        return abs(self.measured_rpm()) > BEYOND_BENCH * self.highest_rpm

    @property
    def rests(self) -> bool | None:
        return False if abs(self.measured_rpm()) > STANDS_RPM else None


@dataclass(frozen=True, slots=True)
class SineSeen:
    """A sine of a shaker, by the channel of the card that shows its force."""

    force: ForceWatch

    def words(self, drive: SineDrive) -> str:
        shown = self.force.shown(drive.amplitude)
        return f"set the drive to {drive.frequency:g} Hz and turn it up to {shown:.4g} N peak"

    def order(self, drive: SineDrive) -> tuple[float, ...]:
        return (drive.frequency, drive.amplitude)

    def shown(self) -> tuple[float, ...]:
        return (self.force.frequency_hz, self.force.amplitude)

    def told(self) -> str:
        unit = self.force.channel.unit
        if not self.force.shows:
            return f"{self.force.channel.name} shows no number"
        return f"{self.force.frequency_hz:.5g} Hz, {self.force.amplitude:.3g} {unit} peak"

    def is_set(self, drive: SineDrive) -> bool:
        frequency_hz, amplitude = self.shown()
        right = abs(frequency_hz - drive.frequency) <= _FREQUENCY_SHARE * drive.frequency
        shown = self.force.shown(drive.amplitude)
        return right and abs(amplitude - shown) <= _FORCE_SHARE * shown

    @property
    def beyond(self) -> bool:
        return False  # the guard holds the measured force to the bench with every reading

    @property
    def rests(self) -> bool | None:
        return self.force.shows and self.force.strength <= _FAINT * self.force.highest


class ByHand:
    """The `Motion` of a rig whose `drive` a person sets.

    `wait` waits that many seconds and may raise. `seen` shows the drive, of a shaker once a card's channel is
    known; `alive` tells whether anything is measured at all, once the card records.
    """

    def __init__(
        self,
        person: ManualActuator,
        drive: Any,
        wait: Callable[[float], None],
        seen: Seen | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._person, self._drive, self._wait = person, drive, wait
        self.seen, self._clock = seen, clock or SystemClock()
        self.alive: Callable[[], bool] = lambda: False
        self._too_much = Debounced(OVERSPEED_S)
        self._asked_to_rest = threading.Lock()  # held from then on: once is enough
        self._rests = self._moved = False
        self._shown_s: float | None = None  # when it was last seen to move since rest was asked for
        self._notices: list[Notice] = []

    @property
    def what(self) -> str:
        return f"{self._seen.told()}, set by hand"

    @property
    def speed_rad_s(self) -> float | None:
        speed: float | None = getattr(self._drive, "speed", None)
        return speed

    @property
    def longest_stop_s(self) -> float:
        return REST_S + _STANDS_S

    @property
    def longest_order_s(self) -> float:
        return HUNG_S

    def with_drive(self, drive: Any) -> ByHand:
        return ByHand(self._person, drive, self._wait, self.seen, self._clock)

    def arm(self, soft: bool, path: Sequence[Any] = ()) -> None:
        self._rests = self._moved = False
        self._shown_s = None
        if self._asked_to_rest.locked():
            self._asked_to_rest.release()

    def start(self, soft: bool, path: Sequence[Any] = ()) -> None:
        """Ask for each drive in turn, and wait until it is measured.

        Raises `InstrumentRefused` where that takes longer than the bench has patience for, `InterlockTripped`
        where it is more than the bench allows.
        """
        for drive in (*path, self._drive):
            self._await(drive)

    def ramp_down(self) -> None:
        self.off()

    def off(self) -> None:
        """Ask for rest, and see that it comes."""
        if self._asked_to_rest.acquire(blocking=False):
            self._person.off()
        end_s, stood_s = self._clock.monotonic_s() + REST_S, 0.0
        while not self._rests and stood_s < _STANDS_S:
            if self._clock.monotonic_s() > end_s:
                shown = self._seen.told() if self.alive() else "nothing is measured any more"
                what = f"it is not seen at rest ({shown})"
                if self.alive() and self._seen.rests is None:
                    what = f"nothing shows whether it rests: since that was asked for it was still ({shown})"
                raise self._refused(what, "the rig itself: STOP IT BY HAND")
            self._clock.sleep(_STEP_S)
            stood_s = stood_s + _STEP_S if self.alive() and self._stands() else 0.0
        self._rests = True  # seen once is enough too: what measures it may be gone by the next look

    def _stands(self) -> bool:
        """A marker shows no slow shaft, nor does it or an angle show one that turns once its cable is off.

        So no speed is rest only where one was seen since rest was asked for, and no mark comes any more.
        """
        now_s = self._clock.monotonic_s()
        if (rests := self._seen.rests) is not None:
            self._shown_s = now_s
            return rests
        return not self._moved or (self._shown_s is not None and now_s - self._shown_s >= _NEXT_MARK_S)

    def cut(self) -> None:
        self.off()

    def check(self) -> None:
        """Raise InterlockTripped where a person sets more than the bench allows."""
        if self.seen is None:
            return
        beyond = self.seen.beyond
        if self._too_much.look(self._clock.monotonic_s(), holds=beyond, gone=not beyond) is not None:
            raise InterlockTripped(f"interlock: {self.seen.told()}, beyond what the bench allows")

    def take_notices(self) -> tuple[Notice, ...]:
        notices, self._notices = tuple(self._notices), []
        return notices

    def clocks(self, base: CardClock) -> list[ClockRecord]:
        return []

    @property
    def _seen(self) -> Seen:
        if self.seen is None:
            raise self._refused("nothing measures what is set", "the card's channels in the bench file")
        return self.seen

    def _await(self, drive: Any) -> None:
        seen, self._moved = self._seen, True
        words = f"BY HAND: {seen.words(drive)}"
        self._note("manual.asked", seen.words(drive))
        self._ask(f"{words}; the run then goes on by itself", "set", *seen.order(drive))
        held_s, waited_s, told = 0.0, 0.0, ""
        while held_s < HELD_S:
            if waited_s > self._person.settings.patience_s:
                raise self._refused(
                    f"not set within {waited_s:.0f} s: {seen.told()}", "whoever sets it, and the sensor"
                )
            self._wait(_STEP_S)
            waited_s += _STEP_S
            held_s = held_s + _STEP_S if seen.is_set(drive) else 0.0
            if held_s == 0.0 and waited_s % _TELL_S < _STEP_S and (now := seen.told()) != told:
                told = now
                self._ask(f"{words}; measured: {now}", "shows", *seen.shown())
        self._note("manual.set", f"measured: {seen.told()}")

    def _ask(self, words: str, *order: object) -> None:
        """Unless rest was asked for; where that came meanwhile, by another thread, it has the last word."""
        asked = not self._asked_to_rest.locked()
        if asked:
            self._person.ask(words, *order)
        if self._asked_to_rest.locked():
            if asked:
                self._person.ask(STOP, REST)
            raise self._refused("it is to rest by now", "")

    def _note(self, code: str, text: str) -> None:
        self._notices.append(Notice(self._clock.monotonic_s(), "info", code, text))

    def _refused(self, what: str, check: str) -> InstrumentRefused:
        return InstrumentRefused(self._person.name, self._person.address, what, check)
