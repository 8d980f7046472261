"""What the rig asks of an acquisition card, and what an emulated one asks of its plant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag
from daq.channel import Channel
from drivers.protocols.instrument import ActuatorOutput

Output_contra = TypeVar("Output_contra", bound=ActuatorOutput, contravariant=True)


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
    channel's unit; `flags` has one entry a channel. `arrived_s` is when they were there, in s of the
    monotonic clock, before anything was made of them. `findings` are those that came up with this reading;
    one that lasts is not told again.
    """

    first_sample: int
    values: NDArray[np.float64]
    flags: tuple[Flag, ...]
    arrived_s: float
    findings: tuple[Finding, ...] = ()


class AcquisitionCard(Protocol):
    """A card that samples all its channels with one clock."""

    @property
    def name(self) -> str:
        """What the bench calls it."""

    @property
    def address(self) -> str:
        """Where it is."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels in the order of the rows of a reading."""

    @property
    def sample_rate(self) -> float:
        """Samples a second as the device really runs, in Hz; known after `open`."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the operator should know and the run may ignore, e.g. an expired calibration."""

    def open(self) -> None:
        """Connect, check devices and channels, arm. Raises `InstrumentAbsent`, `InstrumentRefused`."""

    def close(self) -> None:
        """Give the device back. Never raises for a device that is gone."""

    def arm(self) -> None:
        """Do all that a start needs but the start, so that this one is as short as it can be."""

    def start(self) -> None:
        """Start the sample clock of an armed card; sample 0 is taken before this returns."""

    def started_s(self) -> float | None:
        """When sample 0 was taken, by the device's own stamp, in s of the monotonic clock; after `start`.

        None for a device that does not tell.
        """

    def read(self, count: int) -> CardReading:
        """Wait for the next `count` samples of every channel.

        Raises `RecorderFailed` where samples were overwritten before they were read, `InstrumentSilent` where
        none came in time, `DeviceLost` where the device went away.
        """

    def stop(self) -> None:
        """Stop the sample clock."""


class Plant(Protocol[Output_contra]):
    """The physics behind an emulated card, driven by one kind of actuator: what its sensors would see."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows that `advance` returns."""

    def start(self, sample_rate: float) -> None:
        """Begin anew, with sample 0 next, at `sample_rate` Hz."""

    def drive(self, output: Output_contra, at_sample: float) -> None:
        """Follow the actuator from the (fractional) sample `at_sample` on.

        What began before samples that have been made already is under way by the next.
        """

    def advance(self, count: int) -> NDArray[np.float64]:
        """Return the next `count` samples, shape (channels, count), in SI units with the sensor noise in."""
