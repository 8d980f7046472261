"""What the rig asks of a function generator, and what an emulated one puts out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.protocols.instrument import Actuator


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """What a generator puts out from `started_s` on: `offset_v + amplitude_v * sin(phase)`.

    The phase is `phase_rad` at `started_s` and grows by `2 pi frequency_hz` rad/s. `amplitude_v` is the peak
    in volts at the high-impedance output, `started_s` is in seconds of the monotonic clock (`SystemClock`).
    With `on` false the output is at 0 V, whatever the other fields say.
    """

    on: bool
    frequency_hz: float
    amplitude_v: float
    offset_v: float
    started_s: float
    phase_rad: float = 0.0


class DriveGenerator(Actuator, Protocol):
    """A function generator that drives the shaker with a sine; its safe state is output off.

    `close` leaves the output as it is. One whose output is on already is refused by `open` and `arm_sine`,
    and left as it is, also by `off`.
    """

    def arm_sine(self, frequency_hz: float, amplitude_v: float, offset_v: float, *, triggered: bool) -> None:
        """Prepare a sine (Hz, V peak and V into high impedance); the shaker stays at rest.

        Not triggered: `start` turns the output on. Triggered: the output is on and waits at the offset;
        `start` lets the sine begin at phase 0 with its full amplitude.
        """

    def start(self) -> None:
        """Let the armed sine begin."""

    def set_frequency(self, frequency_hz: float) -> None:
        """Change the frequency (Hz) of a running sine; its phase goes on."""

    def set_amplitude(self, amplitude_v: float) -> None:
        """Change the peak amplitude (V) of a running sine; its phase goes on."""

    def set_offset(self, offset_v: float) -> None:
        """Change the offset (V) of a running sine."""

    def check(self) -> None:
        """Ask whether it puts out what it was told; some calls within half a second ask for all of it."""
