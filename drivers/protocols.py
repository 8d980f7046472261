"""What the rig asks of a generator and a card, and what an emulated card asks of its plant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daq import Channel, Flag


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
