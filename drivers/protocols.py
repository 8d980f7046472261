"""What the rig asks of a generator, a card and an encoder, and what emulated ones ask of their plant."""

from __future__ import annotations

import math
from collections.abc import Callable
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
class CardReading:
    """Consecutive samples of all channels of a card.

    `first_sample` counts since the start of the task; `values` has shape (channels, n), row by row in the
    channel's unit; `flags` has one entry a channel.
    """

    first_sample: int
    values: NDArray[np.float64]
    flags: tuple[Flag, ...]


@dataclass(frozen=True, slots=True)
class PositionGap:
    """`count` position frames from number `first_frame` on that are not in any block, and why."""

    first_frame: int
    count: int
    cause: str


@dataclass(frozen=True, slots=True)
class PositionBlock:
    """Position frames as they came, in the order of their timestamps; all arrays have shape (n,), n >= 1.

    `number` counts frames since `start`, missing ones included, so that a gap is a jump in it. `arrival_s` is
    when this machine had the frame (monotonic clock), `timestamp_s` when the interface or device says it was
    (s since the Unix epoch by a clock of its own). `counts` are raw, from 0 to the encoder's total range.
    """

    number: NDArray[np.int64]
    arrival_s: NDArray[np.float64]
    timestamp_s: NDArray[np.float64]
    counts: NDArray[np.int64]
    gaps: tuple[PositionGap, ...] = ()
    flags: Flag = Flag.GOOD


@dataclass(frozen=True, slots=True)
class PositionStatistics:
    """What became of the frames since `start`.

    `frames` were kept and `missing` are known not to have come; of these `queue_overruns` were thrown away
    here because nobody read, and `late`, `wrong_length` and `out_of_range` were rejected. `reordered` were
    put in their place, `duplicates` dropped. `period_ppm` is by how much frames lie further apart than asked
    for, in the clock of the timestamps; NaN until known.
    """

    frames: int = 0
    missing: int = 0
    duplicates: int = 0
    reordered: int = 0
    late: int = 0
    wrong_length: int = 0
    out_of_range: int = 0
    queue_overruns: int = 0
    receiver_overruns: int = 0
    error_frames: int = 0
    clock_steps: int = 0
    emergencies: int = 0
    period_ppm: float = math.nan


@dataclass(frozen=True, slots=True)
class Emergency:
    """What an instrument reports of itself; `arrival_s` by the monotonic clock, `vendor` bytes of its own."""

    arrival_s: float
    code: int
    register: int
    vendor: bytes
    text: str


@dataclass(frozen=True, slots=True)
class Notice:
    """Something for the log: `level` is info, warning or error, `code` is stable, `text` is for people."""

    arrival_s: float
    level: str
    code: str
    text: str


class DriveGenerator(Protocol):
    """A function generator that drives the shaker with a sine.

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
        """Hang up; leaves the output as it is. Never raises."""
        ...

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

    def off(self) -> None:
        """Go to the safe state, output off; no error where it is off or closed already."""
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


class PositionEncoder(Protocol):
    """An absolute rotary encoder that sends positions by itself, each with its own timestamp."""

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

    @property
    def counts_per_revolution(self) -> int:
        """Counts of one turn of the shaft; known after `open`."""
        ...

    @property
    def total_range(self) -> int:
        """Counts after which the position starts again at 0; known after `open`."""
        ...

    @property
    def period_s(self) -> float:
        """Nominal time between two positions, s."""
        ...

    @property
    def emergencies(self) -> tuple[Emergency, ...]:
        """The emergencies that the encoder has not taken back; any one should stop the rig."""
        ...

    @property
    def statistics(self) -> PositionStatistics:
        """What became of the frames since `start`."""
        ...

    def open(self) -> None:
        """Connect, verify identity and settings, set the period; listing all differences at once.

        Raises `InstrumentAbsent`, `InstrumentRefused`, `InstrumentSilent`.
        """
        ...

    def close(self) -> None:
        """Hang up. Never raises."""
        ...

    def preset(self, counts: int) -> None:
        """Let the encoder call its present position `counts`. Raises `InstrumentRefused`."""
        ...

    def start(self) -> None:
        """Let it send positions; frame 0 is the next."""
        ...

    def read(self, count: int) -> PositionBlock:
        """Wait for the next `count` positions; fewer only where there will be no more.

        Raises `DeviceLost`, naming the last good position, once all that came before has been read;
        `InstrumentSilent` where the encoder lives but sends no position in time.
        """
        ...

    def take_notices(self) -> tuple[Notice, ...]:
        """Return what happened since the last call, oldest first; also after an error."""
        ...

    def stop(self) -> None:
        """Let it send no more."""
        ...


Shaft = Callable[[float], float]
"""Angle of a shaft in rad, not wrapped, at a time in s of the monotonic clock, which all processes share."""


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
