"""What the rig asks of what turns a motor, and what an emulated one asks of that motor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from drivers.protocols.instrument import Instrument, Notice


@dataclass(frozen=True, slots=True)
class MotorState:
    """What an inverter or a DC supply said of itself at `at_s` (s of the monotonic clock).

    `set_rpm` is the speed that it keeps as its set value, `speed_rpm` follows from its output frequency or
    voltage: no slip is in it. `fault` is what its display shows, empty for none; `degraded` that its line is
    disturbed.
    """

    at_s: float
    running: bool
    set_rpm: float
    speed_rpm: float
    output_frequency_hz: float
    output_current_a: float
    output_voltage_v: float
    fault: str = ""
    degraded: bool = False


class SpeedDrive(Instrument, Protocol):
    """An inverter, or a DC supply, that turns the rig's crank at a set speed.

    Every method may raise `InstrumentRefused` (it said no, tripped, or does something else than asked),
    `InstrumentSilent` (no answer in time) and, once open, `DeviceLost`. After the first of these that
    endangers the rig the motor is stopped and every call raises it again, until the drive is closed.
    """

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the operator should know and the run may ignore; known after `open`."""

    @property
    def state(self) -> MotorState | None:
        """What it said last, at most some poll periods ago; no word goes out for it."""

    @property
    def step_rpm(self) -> float:
        """The smallest step of the set speed."""

    @property
    def longest_stop_s(self) -> float:
        """By when a stop has ended or raised, in s since it was asked for; known after `open`."""

    @property
    def busy(self) -> bool:
        """Whether what a caller waits for goes on; not where it hangs, as far as that can be told."""

    def ramp_s(self, from_rpm: float, to_rpm: float) -> float:
        """Return the time in s that its ramp takes from one speed to another; known after `open`."""

    def open(self) -> None:
        """Connect and check its settings; moves nothing.

        From here on it is polled, which keeps its watchdog quiet. Raises `InstrumentAbsent` as well.
        """

    def close(self) -> None:
        """Stop the motor if it may be turning, answer or not, and hang up. Never raises."""

    def arm(self, rpm: float) -> float:
        """Prepare it for a start at that speed; nothing moves. Returns the speed as `set_speed` does."""

    def set_speed(self, rpm: float) -> float:
        """Set the speed in rpm; a running motor goes there on its ramp. Returns it as the drive keeps it."""

    def start(self) -> None:
        """Run forward, up to the set speed on the ramp; refused where it was stopped since it was armed."""

    def stop(self, measured_rpm: Callable[[], float] | None = None) -> None:
        """Stop in category 1: ramp to zero, see that it stands, run withdrawn; no error where it stands.

        The speed is taken from `measured_rpm` where that gives a finite one, else from the output frequency.
        Where the ramp overruns 1.5 times its time, run is withdrawn at once. A DC supply, which cannot brake,
        switches off at once, and the motor coasts.
        """

    def cut(self) -> None:
        """Withdraw run at once, also while another thread waits for a `stop`; no error where it stands."""

    def read(self) -> MotorState:
        """Ask it how it is."""

    def check(self) -> None:
        """Raise what went wrong since it was opened; every call says that somebody looks after the motor."""

    def take_notices(self) -> tuple[Notice, ...]:
        """Return what happened since the last call, oldest first; also after an error."""


@dataclass(frozen=True, slots=True)
class MotorOutput:
    """What turns a motor from `started_s` (s of the monotonic clock) on: Hz of an inverter, V of a DC supply.

    It goes from `level` to `target` by `slope_per_s` (>= 0) and stays there. With `on` false nothing is put
    out and the motor coasts.
    """

    on: bool
    level: float
    target: float
    slope_per_s: float
    started_s: float

    @property
    def settled_s(self) -> float:
        """When the target is reached."""
        way = abs(self.target - self.level)
        return self.started_s + (way / self.slope_per_s if way > 0.0 else 0.0)

    def at(self, time_s: float) -> float:
        """Return the level at `time_s`; 0 while it is off."""
        if not self.on:
            return 0.0
        way = self.target - self.level
        step = self.slope_per_s * max(time_s - self.started_s, 0.0)
        return self.target if step >= abs(way) else self.level + (step if way > 0.0 else -step)


class MotorLoad(Protocol):
    """The motor and what it turns, as an emulated inverter feels them."""

    def drive(self, output: MotorOutput) -> None:
        """Take what the inverter puts out from now on."""

    def current_a(self) -> float:
        """Return the motor current in A, as it is now."""
