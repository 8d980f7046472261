"""What the rig asks of a rotary encoder, and what an emulated one asks of its shaft."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag
from drivers.protocols.instrument import Instrument, Notice


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
    (s since the Unix epoch by a clock of its own; where that is set and no frame is missing, times go on as
    if it had not been). `counts` are raw, from 0 to the encoder's total range.
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
    put in their place, `duplicates` dropped; `uncertain` have a number that may be another, and carry
    CLOCK_NOT_LOCKED: those after them do not, though their numbers may stay off by as much.
    `period_ppm` is by how much frames lie further apart than asked for, in the clock of the timestamps; NaN
    until known.
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
    uncertain: int = 0
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


class PositionEncoder(Instrument, Protocol):
    """An absolute rotary encoder that sends positions by itself, each with its own timestamp."""

    @property
    def counts_per_revolution(self) -> int:
        """Counts of one turn of the shaft; known after `open`."""

    @property
    def total_range(self) -> int:
        """Counts after which the position starts again at 0; known after `open`."""

    @property
    def period_s(self) -> float:
        """Nominal time between two positions, s."""

    @property
    def emergencies(self) -> tuple[Emergency, ...]:
        """The emergencies that the encoder has not taken back; any one should stop the rig."""

    @property
    def statistics(self) -> PositionStatistics:
        """What became of the frames since `start`."""

    def open(self) -> None:
        """Connect, verify identity and settings, set the period; listing all differences at once.

        Raises `InstrumentAbsent`, `InstrumentRefused`, `InstrumentSilent`.
        """

    def close(self) -> None:
        """Hang up. Never raises."""

    def preset(self, counts: int) -> None:
        """Let the encoder call its present position `counts`. Raises `InstrumentRefused`."""

    def start(self) -> None:
        """Let it send positions; frame 0 is the next."""

    def read(self, count: int) -> PositionBlock:
        """Wait for the next `count` positions; fewer only where there will be no more.

        Raises `DeviceLost`, naming the last good position, once all that came before has been read;
        `InstrumentSilent` where the encoder lives but sends no position in time.
        """

    def take_notices(self) -> tuple[Notice, ...]:
        """Return what happened since the last call, oldest first; also after an error."""

    def stop(self) -> None:
        """Let it send no more."""


Shaft = Callable[[float], float]
"""Angle of a shaft in rad, not wrapped, at a time in s of the monotonic clock, which all processes share."""
