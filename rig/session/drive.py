"""What moves in a run: soft start, full start from rest, ramp down, off."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from daq.errors import InstrumentError
from drivers.protocols import Actuator, DriveGenerator
from rig.files.rigs.impact_beam import DriveSection
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

    def arm(self, soft: bool) -> None:
        """Prepare; nothing moves yet."""
        ...

    def start(self, soft: bool) -> None:
        """Let it move: softly, or at once from phase zero."""
        ...

    def ramp_down(self) -> None:
        """Bring it down softly, then switch off."""
        ...


@contextmanager
def drive_off_after(actuator: Actuator, spare: Callable[[], Actuator], screen: Screen) -> Iterator[None]:
    """Switch the drive off on every way out, by a new connection where the old one fails.

    If even that fails, say so without hiding why the run ended.
    """
    try:
        yield
    except BaseException:
        try:
            actuator.off()
        except InstrumentError as error:
            screen.warn(f"{error}")
            if not switch_off(spare):
                screen.warn("THE DRIVE MAY STILL BE ON: switch it off by hand")
        raise
    actuator.off()


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

    def _set(self, share: float) -> None:
        if self._amplitude_v >= _SMALLEST_V:
            self.generator.set_amplitude(max(share * self._amplitude_v, _SMALLEST_V))
        if self._offset_v:
            self.generator.set_offset(share * self._offset_v)
