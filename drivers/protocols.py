"""What the rig asks of a generator, a speed drive and a card, and what emulators ask of their plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daq import Channel, Flag
from daq.log.records import Event


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


@dataclass(frozen=True, slots=True)
class Finding:
    """Something about a channel that no flag of a block can say; `code` is one word, `text` says it all."""

    channel: str
    code: str
    text: str


@dataclass(frozen=True, slots=True)
class CardReading:
    """Consecutive samples of all channels of a card, analog or counted, on one sample grid.

    `first_sample` counts since the start of the task; `values` has shape (channels, n), row by row in the
    channel's unit; `flags` has one entry a channel. `findings` are those that came up with this reading; one
    that lasts is not told again.
    """

    first_sample: int
    values: NDArray[np.float64]
    flags: tuple[Flag, ...]
    findings: tuple[Finding, ...] = ()


class Actuator(Protocol):
    """An instrument that moves the rig.

    Every method may raise `InstrumentRefused` (it said no, or a limit of ours forbids it), `InstrumentSilent`
    (no answer in time) and, once open, `DeviceLost`.
    """

    @property
    def name(self) -> str:
        """What the bench calls it."""
        ...

    @property
    def address(self) -> str:
        """Where it is."""
        ...

    @property
    def identity(self) -> str:
        """What it says it is; empty before `open`."""
        ...

    def open(self) -> None:
        """Connect and check the model; moves nothing. Raises `InstrumentAbsent` as well."""
        ...

    def close(self) -> None:
        """Hang up. Never raises."""
        ...

    def off(self) -> None:
        """Go to the safe state; no error where it is there or closed already."""
        ...


class DriveGenerator(Actuator, Protocol):
    """A function generator that drives the shaker with a sine; its safe state is output off.

    `close` leaves the output as it is.
    """

    def arm_sine(self, frequency_hz: float, amplitude_v: float, offset_v: float, *, triggered: bool) -> None:
        """Prepare a sine (Hz, V peak and V into high impedance); the shaker stays at rest.

        Not triggered: `start` turns the output on. Triggered: the output is on and waits at the offset;
        `start` lets the sine begin at phase 0 with its full amplitude.
        """
        ...

    def start(self) -> None:
        """Let the armed sine begin."""
        ...

    def set_amplitude(self, amplitude_v: float) -> None:
        """Change the peak amplitude (V) of a running sine; its phase goes on."""
        ...

    def set_offset(self, offset_v: float) -> None:
        """Change the offset (V) of a running sine."""
        ...


class AcquisitionCard(Protocol):
    """A card that samples all its channels with one clock."""

    @property
    def name(self) -> str:
        """What the bench calls it."""
        ...

    @property
    def address(self) -> str:
        """Where it is."""
        ...

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels in the order of the rows of a reading."""
        ...

    @property
    def sample_rate(self) -> float:
        """Samples a second as the device really runs, in Hz; known after `open`."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the operator should know and the run may ignore, e.g. an expired calibration."""
        ...

    @property
    def total_acquired(self) -> int:
        """Samples per channel that the device has taken since `start`, read or not."""
        ...

    def open(self) -> None:
        """Connect, check devices and channels, arm. Raises `InstrumentAbsent`, `InstrumentRefused`."""
        ...

    def close(self) -> None:
        """Give the device back. Never raises for a device that is gone."""
        ...

    def start(self) -> None:
        """Start the sample clock; sample 0 is taken now."""
        ...

    def read(self, count: int) -> CardReading:
        """Wait for the next `count` samples of every channel.

        Raises `RecorderFailed` where samples were overwritten before they were read, `InstrumentSilent` where
        none came in time, `DeviceLost` where the device went away.
        """
        ...

    def stop(self) -> None:
        """Stop the sample clock."""
        ...


class Plant(Protocol):
    """The physics behind an emulated card: what its sensors would see."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows that `advance` returns."""
        ...

    def start(self, sample_rate: float) -> None:
        """Begin anew, with sample 0 next, at `sample_rate` Hz."""
        ...

    def drive(self, settings: DriveSettings, at_sample: float) -> None:
        """Take new settings from the (fractional) sample `at_sample` on, which is none made already."""
        ...

    def advance(self, count: int) -> NDArray[np.float64]:
        """Return the next `count` samples, shape (channels, count), in SI units with the sensor noise in."""
        ...


@dataclass(frozen=True, slots=True)
class MotorState:
    """What an inverter said of itself at `at_s` (s of the monotonic clock).

    `set_rpm` is the speed that it keeps as its set value, `speed_rpm` follows from its output frequency: no
    slip is in it. `fault` is what its display shows, empty for none; `degraded` that its line is disturbed.
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


class SpeedDrive(Protocol):
    """An inverter that turns the rig's crank at a set speed.

    Every method may raise `InstrumentRefused` (it said no, tripped, or does something else than asked),
    `InstrumentSilent` (no answer in time) and, once open, `DeviceLost`. After the first of these that
    endangers the rig the motor is stopped and every call raises it again, until the drive is closed.
    """

    @property
    def name(self) -> str:
        """What the bench calls it."""
        ...

    @property
    def address(self) -> str:
        """Where it is."""
        ...

    @property
    def identity(self) -> str:
        """What is known of it; empty before `open`."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the operator should know and the run may ignore; known after `open`."""
        ...

    @property
    def state(self) -> MotorState | None:
        """What it said last, at most some poll periods ago; no word goes out for it."""
        ...

    def open(self) -> None:
        """Connect and check its settings; moves nothing.

        From here on it is polled, which keeps its watchdog quiet. Raises `InstrumentAbsent` as well.
        """
        ...

    def close(self) -> None:
        """Stop the motor if it may be turning, answer or not, and hang up. Never raises."""
        ...

    def set_speed(self, rpm: float) -> float:
        """Set the speed in rpm; a running motor goes there on its ramp. Returns it as the drive keeps it."""
        ...

    def start(self) -> None:
        """Run forward, up to the set speed on the ramp."""
        ...

    def stop(self, measured_rpm: Callable[[], float] | None = None) -> None:
        """Stop in category 1: ramp to zero, see that it stands, then withdraw run; no error where it stands.

        The speed is taken from `measured_rpm` where that gives a finite one, else from the output frequency.
        Where the ramp overruns 1.5 times its time, run is withdrawn at once.
        """
        ...

    def read(self) -> MotorState:
        """Ask it how it is."""
        ...

    def check(self) -> None:
        """Raise what went wrong since it was opened; every call says that somebody looks after the motor."""
        ...

    def fault_history(self) -> tuple[str, ...]:
        """What its display showed at its last faults, newest first."""
        ...

    def events(self) -> tuple[Event, ...]:
        """What happened since the last call, oldest first."""
        ...


@dataclass(frozen=True, slots=True)
class InverterOutput:
    """What an inverter puts out from `started_s` (s of the monotonic clock) on.

    The frequency goes from `frequency_hz` to `target_hz` by `slope_hz_per_s` (>= 0) and stays there. With
    `on` false nothing is put out and the motor coasts.
    """

    on: bool
    frequency_hz: float
    target_hz: float
    slope_hz_per_s: float
    started_s: float

    @property
    def settled_s(self) -> float:
        """When the target is reached."""
        way = abs(self.target_hz - self.frequency_hz)
        return self.started_s + (way / self.slope_hz_per_s if way > 0.0 else 0.0)

    def at(self, time_s: float) -> float:
        """Return the frequency in Hz at `time_s`; 0 while it is off."""
        if not self.on:
            return 0.0
        way = self.target_hz - self.frequency_hz
        step = self.slope_hz_per_s * max(time_s - self.started_s, 0.0)
        return self.target_hz if step >= abs(way) else self.frequency_hz + (step if way > 0.0 else -step)


class MotorLoad(Protocol):
    """The motor and what it turns, as an emulated inverter feels them."""

    def drive(self, output: InverterOutput) -> None:
        """Take what the inverter puts out from now on."""
        ...

    def current_a(self) -> float:
        """Return the motor current in A, as it is now."""
        ...
