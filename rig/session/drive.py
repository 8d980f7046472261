"""What moves in a run: soft start, full start from rest, ramp down, off."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol

from daq.log.records import ClockRecord
from daq.time_base.clocks import CardClock
from drivers.protocols.generator import DriveGenerator
from drivers.protocols.instrument import Actuator, Notice
from rig.session.interlock import HUNG_S
from rig.session.progress import Screen
from rig.session.supervisor import switch_off
from sim_twin.rigs.impact_beam.model import SineDrive

RAMP_S = 0.4  # one way; its steps of 25 ms keep a shaker from a jolt
_RAMP_STEPS = 16  # the first two come to the eighth that is proved
_SMALLEST_V = 0.01
"""V peak: the least amplitude of a 33220A into high impedance."""


class Motion(Protocol):
    """What an actuator does in a run."""

    @property
    def what(self) -> str: ...

    @property
    def speed_rad_s(self) -> float | None:
        """What the crank shall turn at once started; None where nothing turns."""

    @property
    def longest_stop_s(self) -> float:
        """How long `off` and `ramp_down` may look at nothing else, in s."""

    @property
    def longest_order_s(self) -> float:
        """How long a sequence may look at nothing else by now, in s; one that takes longer hangs."""

    def with_drive(self, drive: Any) -> Motion:
        """The same actuator for another section [drive]; of one that is at rest."""

    def arm(self, soft: bool, path: Sequence[Any] = ()) -> None:
        """Prepare; nothing moves yet. `path`: drives (sections [drive]) that it shall come through."""

    def start(self, soft: bool, path: Sequence[Any] = ()) -> None:
        """Let it move, softly or at once from phase zero; returns when it is as the scenario wants it.

        A soft start comes through the drives of `path`, without a rest.
        """

    def ramp_down(self) -> None:
        """Bring it down softly, then switch off."""

    def off(self) -> None:
        """Go to the safe state, on whatever way out; no error where it is there. For any thread."""

    def cut(self) -> None:
        """Go there without a ramp, and overtake one. For any thread."""

    def check(self) -> None:
        """Raise what went wrong with the actuator; called every 0.1 s while it may move."""

    def take_notices(self) -> tuple[Notice, ...]:
        """Return what happened to the actuator since the last call, oldest first."""

    def clocks(self, base: CardClock) -> list[ClockRecord]:
        """How an actuator that was polled since the last call lies against the run's time base.

        Called in a thread beside the others.
        """


class SwitchedOff(Protocol):
    """Whatever has a safe state to go to."""

    def off(self) -> None: ...

    def close(self) -> None:
        """Hang up, after which `off` sends nothing."""


class Successor(Protocol):
    """Whoever goes on trying to switch a drive off."""

    def take_over(self) -> None:
        """Begin; waits for nothing."""

    def go_on(self) -> str:
        """What a person should know of that; may take its time."""


@contextmanager
def drive_off_after(
    drive: SwitchedOff,
    spare: Callable[[], Actuator] | None,
    screen: Screen,
    successor: Successor | None = None,
    moved: str = "",
    not_off: Callable[[str], None] = lambda _: None,
) -> Iterator[None]:
    """Switch the drive off on every way out, by a new connection where the old one fails, which is closed.

    If even that fails, a `successor` takes over, which is said without hiding why the run ended, and
    `not_off` hears of it. Where nothing else ended it, the drive's failure to go off is raised, whether the
    new connection helped or not. What is raised has a note of how the drive is left where something `moved`:
    what that was, in words.
    """

    def switched_off() -> None:
        """Raises what failed, with a note of how the drive is left."""
        try:
            drive.off()
        except Exception as error:
            may_be_on = _tried_anew(drive, spare)
            taker = successor if may_be_on and spare is not None else None
            if taker is not None:
                taker.take_over()
            error.add_note(may_be_on or f"{moved or 'the drive'} is off, by a new connection")
            with suppress(Exception):  # words after deeds: the terminal may be gone
                _warn_of(error, may_be_on, screen, taker)
            if may_be_on:
                with suppress(Exception):  # of a log
                    not_off(f"{error}; {may_be_on}")
            raise  # the caller must not take it for off

    try:
        yield
    except BaseException as ending:
        left = f"{moved} is off"
        try:
            switched_off()
        except Exception as error:  # told already, and no reason why the run ended
            left = error.__notes__[-1]
        if moved:
            ending.add_note(left)
        raise
    switched_off()


def _tried_anew(drive: SwitchedOff, spare: Callable[[], Actuator] | None) -> str:
    """What may still be on after a new connection, in words."""
    if spare is None:
        return "THE MOTOR MAY STILL TURN: its own watchdog has to stop it; keep clear"
    obeyed = switch_off(spare)
    drive.close()
    return "" if obeyed else "THE DRIVE MAY STILL BE ON: switch it off by hand"


def _warn_of(error: Exception, may_be_on: str, screen: Screen, taker: Successor | None) -> None:
    for each in filter(None, (str(error), may_be_on)):
        screen.warn(each)
    if taker is not None and (words := taker.go_on()):
        screen.warn(words)


@dataclass(frozen=True, slots=True)
class Shaker:
    """The drive of a run in newtons at the drive point.

    `force_per_volt` in N/V is what amplifier and shaker make of a volt; `wait` waits that many seconds and
    may raise. `prove` may raise as well, at the first eighth of the amplitude that a soft start has come to.
    `hold` hears what drives steadily from then on, and of None before that changes; not of a ramp down, of
    which whoever stops knows.
    """

    generator: DriveGenerator
    drive: SineDrive
    force_per_volt: float
    wait: Callable[[float], None]
    prove: Callable[[SineDrive], None] = lambda ordered: None
    hold: Callable[[SineDrive | None], None] = lambda ordered: None
    longest_stop_s: float = 0.0
    """Of `off`, which is one command; `ramp_down` waits by `wait`."""

    @property
    def what(self) -> str:
        return f"{self.drive.amplitude:g} N at {self.drive.frequency:g} Hz"

    @property
    def speed_rad_s(self) -> float | None:
        return None

    @property
    def longest_order_s(self) -> float:
        """Some settings of a generator on a slow line."""
        return HUNG_S

    def with_drive(self, drive: SineDrive) -> Shaker:
        return replace(self, drive=drive)

    def arm(self, soft: bool, path: Sequence[SineDrive] = ()) -> None:
        first = path[0] if path else self.drive  # a soft start waits there and comes to `drive` at its end
        volts = first.amplitude / self.force_per_volt
        amplitude = min(_SMALLEST_V, volts) if soft else volts
        self.generator.arm_sine(first.frequency, amplitude, 0.0, triggered=not soft)

    def start(self, soft: bool, path: Sequence[SineDrive] = ()) -> None:
        """Let it move: softly in steps up to the full amplitude, or at once from phase zero."""
        self.generator.start()
        if soft:
            drives = (*path, self.drive)
            tenth = replace(drives[0], amplitude=drives[0].amplitude / 8, offset=drives[0].offset / 8)
            self._go(replace(drives[0], amplitude=0.0, offset=0.0), tenth, 2)
            self.prove(replace(tenth, amplitude=max(tenth.amplitude, _SMALLEST_V * self.force_per_volt)))
            self._go(tenth, drives[0], _RAMP_STEPS - 2)
            for before, after in pairwise(drives):
                self._go(before, after)
        self.hold(self.drive)

    def shake(self, amplitude: float) -> Shaker:
        """Another amplitude at once, N; the shaker as it drives then."""
        return self._at_once(
            self.generator.set_amplitude, amplitude, replace(self.drive, amplitude=amplitude)
        )

    def push(self, offset: float) -> Shaker:
        """Another offset at once, N; the shaker as it drives then."""
        return self._at_once(self.generator.set_offset, offset, replace(self.drive, offset=offset))

    def _at_once(self, order: Callable[[float], None], newtons: float, drive: SineDrive) -> Shaker:
        self.hold(None)
        order(newtons / self.force_per_volt)
        self.hold(drive)
        return self.with_drive(drive)

    def trim(self, off: float) -> None:
        """Correct the frequency, which was measured to be `off` by that share of it; the phase goes on."""
        self.generator.set_frequency(self.drive.frequency / (1 + off))

    def ramp_down(self) -> None:
        for step in range(_RAMP_STEPS - 1, 0, -1):  # not to 0, which no generator can: off does that
            share = step / _RAMP_STEPS
            self._set_amplitude(share * self.drive.amplitude, self.drive.amplitude)
            if self.drive.offset:
                self.wait(0.0)
                self._set_offset(share * self.drive.offset)
            self.wait(RAMP_S / _RAMP_STEPS)  # looks at all that may end the run
        self.generator.off()

    def off(self) -> None:
        self.generator.off()

    def cut(self) -> None:
        self.generator.off()

    def check(self) -> None:
        self.generator.check()

    def take_notices(self) -> tuple[Notice, ...]:
        return ()

    def clocks(self, base: CardClock) -> list[ClockRecord]:
        return []

    def _go(self, before: SineDrive, after: SineDrive, steps: int = _RAMP_STEPS) -> None:
        largest = max(before.amplitude, after.amplitude)
        orders = (
            (before.frequency, after.frequency, self.generator.set_frequency),
            (before.amplitude, after.amplitude, lambda newtons: self._set_amplitude(newtons, largest)),
            (before.offset, after.offset, self._set_offset),
        )
        changed = [each for each in orders if each[0] != each[1]]
        for step in range(1, steps + 1):
            self.wait(RAMP_S / _RAMP_STEPS)
            for number, (was, becomes, order) in enumerate(changed):
                if number:  # each answer may take its time
                    self.wait(0.0)
                order(_between(was, becomes, step / steps))

    def _set_amplitude(self, newtons: float, largest: float) -> None:
        """On a way with a `largest` below what a generator can do, it is left as it was armed."""
        if largest / self.force_per_volt >= _SMALLEST_V:
            self.generator.set_amplitude(max(newtons / self.force_per_volt, _SMALLEST_V))

    def _set_offset(self, newtons: float) -> None:
        self.generator.set_offset(newtons / self.force_per_volt)


def _between(before: float, after: float, share: float) -> float:
    """`share` of the way from one to the other; exactly `after` for 1."""
    return (1.0 - share) * before + share * after
