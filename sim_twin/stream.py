"""Samples of a twin as its instruments give them: the true motion through every channel's measuring chain."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.sensors import SensorChain, oversampling, sensor_stream
from sim_twin.status import Status
from sim_twin.twin import AnyTwin

Array = NDArray[np.float64]


class Truth(Protocol):
    """What really happens at the channels, on a fine grid of times k / rate from t = 0 on.

    Until the first `change_drive` nothing moves.
    """

    def change_drive(self, drive: Any, phase: float, reference: float) -> None:
        """Drive like this from the present on; `phase` (rad; of sine or crank) at `reference` s.

        The first drive of a crank starts it in full motion, at the angle that it has now.
        """

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (channels, steps), rows in the order of the twin's channels."""

    def shape(self) -> Array:
        """What a picture of the rig needs of the present state."""

    @property
    def status(self) -> Status:
        """How the simulation stands; after a failure `advance` gives no further samples."""


class TwinStream:
    """Samples of a twin, from rest at sample 0 on, as they come.

    The drive is off until `drive` sets it. With `rng` the samples carry noise and quantisation.
    `truth` runs at `sample_rate` times `oversampling(sample_rate)`.
    """

    def __init__(
        self, twin: AnyTwin, truth: Truth, sample_rate: float, rng: np.random.Generator | None = None
    ) -> None:
        self.twin, self.sample_rate = twin, sample_rate
        self._truth = truth
        self._factor = oversampling(sample_rate)
        self._chains = [
            sensor_stream(twin.sensors.get(name, SensorChain()), sample_rate, rng) for name in twin.channels
        ]
        self._plugged = twin.plugged
        self._lookahead = max(chain.lookahead for chain in self._chains)
        self._delivered = 0
        self._steps = 0
        self._pending: list[tuple[int, Any, float, float]] = []

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows that `advance` gives."""
        return self.twin.channels

    def drive(self, drive: Any, phase: float = 0.0, at_sample: float | None = None) -> None:
        """Change the drive at `at_sample` (fractional; default: the next one), at `phase` rad.

        Changes come in the order of their samples. What lies in the past takes effect now, in its phase.
        """
        sample = float(self._delivered if at_sample is None else at_sample)
        self._pending.append((round(sample * self._factor), drive, phase, sample / self.sample_rate))

    def advance(self, count: int) -> Array:
        """Return the next `count` samples, shape (channels, count).

        Raises SimulationFailed where the motion cannot be computed any further.
        """
        self._delivered += count
        end = self._delivered * self._factor + self._lookahead
        while self._steps < end:
            while self._pending and self._pending[0][0] <= self._steps:
                self._truth.change_drive(*self._pending.pop(0)[1:])
            stop = min(end, self._pending[0][0]) if self._pending else end
            fine = self._truth.advance(stop - self._steps)
            status = self._truth.status
            if status is not Status.COMPLETED:
                what = f"the twin stopped after {self._steps / (self.sample_rate * self._factor):.6g} s"
                raise SimulationFailed(what, status.advice, status)
            for chain, row in zip(self._chains, self._plugged, strict=True):
                chain.push(fine[row])
            self._steps = stop
        return np.array([chain.pull(count) for chain in self._chains])

    def shape(self) -> tuple[float, Array]:
        """Time (s) of the present state, and what a picture of the rig needs of it."""
        return self._steps / (self.sample_rate * self._factor), self._truth.shape()
