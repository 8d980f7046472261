"""What moves in a run: soft start, full start from rest, ramp down, off."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Protocol

from daq.errors import InstrumentError
from daq.log.records import ClockRecord
from drivers.protocols import Actuator, DriveGenerator, Notice
from rig.files.rigs.impact_beam import DriveSection
from rig.session.clocks import CardClock
from rig.session.progress import Screen
from rig.session.supervisor import switch_off

RAMP_S = 0.4
_RAMP_STEPS = 16
_SMALLEST_V = 0.01
"""V peak: the least amplitude of a 33220A into high impedance."""


class Motion(Protocol):
    """What an actuator does in a run."""

    @property
    def what(self) -> str:
        """The drive in words, for the log."""
        ...

    @property
    def speed_rad_s(self) -> float | None:
        """What the crank shall turn at once started; None where nothing turns."""
        ...

    @property
    def longest_stop_s(self) -> float:
        """How long `off` and `ramp_down` may look at nothing else, in s."""
        ...

    def arm(self, soft: bool) -> None:
        """Prepare; nothing moves yet."""
        ...

    def start(self, soft: bool) -> None:
        """Let it move, softly or at once from phase zero; returns when it is as the scenario wants it."""
        ...

    def ramp_down(self) -> None:
        """Bring it down softly, then switch off."""
        ...

    def off(self) -> None:
        """Go to the safe state, on whatever way out; no error where it is there."""
        ...

    def check(self) -> None:
        """Raise what went wrong with the actuator; called at least every 5 s while it may move."""
        ...

    def take_notices(self) -> tuple[Notice, ...]:
        """Return what happened to the actuator since the last call, oldest first."""
        ...

    def clocks(self, base: CardClock) -> list[ClockRecord]:
        """How an actuator that was polled since the last call lies against the run's time base."""
        ...


class SwitchedOff(Protocol):
    """Whatever has a safe state to go to."""

    def off(self) -> None:
        """Go there."""
        ...


@contextmanager
def drive_off_after(
    drive: SwitchedOff, spare: Callable[[], Actuator] | None, screen: Screen
) -> Iterator[None]:
    """Switch the drive off on every way out, by a new connection where the old one fails.

    If even that fails, say so without hiding why the run ended. Where nothing else ended it, the drive's
    failure to go off is raised, whether the new connection helped or not.
    """
    try:
        yield
    except BaseException:
        with suppress(InstrumentError):  # told already, and no reason why the run ended
            _switch_off(drive, spare, screen)
        raise
    _switch_off(drive, spare, screen)


def _switch_off(drive: SwitchedOff, spare: Callable[[], Actuator] | None, screen: Screen) -> None:
    try:
        drive.off()
    except InstrumentError as error:
        screen.warn(f"{error}")
        if spare is None:
            screen.warn("THE MOTOR MAY STILL TURN: its own watchdog has to stop it; keep clear")
        elif not switch_off(spare):
            screen.warn("THE DRIVE MAY STILL BE ON: switch it off by hand")
        raise


@dataclass(frozen=True, slots=True)
class Shaker:
    """The drive of a run in newtons at the drive point.

    `force_per_volt` in N/V is what amplifier and shaker make of a volt; `wait` waits that many seconds and
    may raise.
    """

    generator: DriveGenerator
    drive: DriveSection
    force_per_volt: float
    wait: Callable[[float], None]

    @property
    def what(self) -> str:
        """The drive in words."""
        return f"{self.drive.amplitude:g} N at {self.drive.frequency:g} Hz"

    @property
    def _amplitude_v(self) -> float:
        return self.drive.amplitude / self.force_per_volt

    @property
    def _offset_v(self) -> float:
        return self.drive.offset / self.force_per_volt

    @property
    def speed_rad_s(self) -> float | None:
        """None: nothing turns."""
        return None

    @property
    def longest_stop_s(self) -> float:
        """Nothing: `ramp_down` waits by `wait`, and `off` is one command."""
        return 0.0

    def arm(self, soft: bool) -> None:
        """Prepare the sine, without its offset; nothing moves yet."""
        amplitude = min(_SMALLEST_V, self._amplitude_v) if soft else self._amplitude_v
        self.generator.arm_sine(self.drive.frequency, amplitude, 0.0, triggered=not soft)

    def start(self, soft: bool) -> None:
        """Let it move: softly in steps up to the full amplitude, or at once from phase zero."""
        self.generator.start()
        if soft:
            for step in range(1, _RAMP_STEPS + 1):
                self.wait(RAMP_S / _RAMP_STEPS)
                self._set(step / _RAMP_STEPS)

    def trim(self, off: float) -> None:
        """Correct the frequency, which was measured to be `off` by that share of it; the phase goes on."""
        self.generator.set_frequency(self.drive.frequency / (1 + off))

    def ramp_down(self) -> None:
        """Bring the amplitude down in steps, then switch off."""
        for step in range(_RAMP_STEPS - 1, 0, -1):
            self._set(step / _RAMP_STEPS)
            self.wait(RAMP_S / _RAMP_STEPS)
        self.generator.off()

    def off(self) -> None:
        """Switch the output off at once."""
        self.generator.off()

    def check(self) -> None:
        """A generator tells of nothing by itself."""

    def take_notices(self) -> tuple[Notice, ...]:
        """None."""
        return ()

    def clocks(self, base: CardClock) -> list[ClockRecord]:
        """None: it is not polled."""
        return []

    def _set(self, share: float) -> None:
        if self._amplitude_v >= _SMALLEST_V:
            self.generator.set_amplitude(max(share * self._amplitude_v, _SMALLEST_V))
        if self._offset_v:
            self.generator.set_offset(share * self._offset_v)
