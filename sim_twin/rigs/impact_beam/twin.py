"""The twin of an impact beam bench: the rig, what drives it and its measuring chains; and its samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.impact_beam.assembly import assemble, deflection_shapes
from sim_twin.rigs.impact_beam.channels import channel_names
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.sensors import SensorChain, SensorStream, oversampling, resonance
from sim_twin.switched import Simulation

Array = NDArray[np.float64]
_ORDERS = (0, 1, 2, 3)
_SHAPE_POINTS = 29


@dataclass(frozen=True, slots=True)
class BeamTwin:
    """What is simulated; channels without an entry in `sensors` have the ideal chain."""

    rig: ImpactBeam
    drive: SineDrive
    sensors: Mapping[str, SensorChain] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows of its samples."""
        return channel_names(self.rig)


class BeamStream:
    """Samples of a twin, from rest at sample 0 on, as they come.

    The drive is off until `drive` sets it. With `rng` the samples carry noise and quantisation. A stream
    whose drive will get an offset or harmonics later on is made with `pure_sine` False.
    """

    def __init__(
        self,
        twin: BeamTwin,
        sample_rate: float,
        rng: np.random.Generator | None = None,
        pure_sine: bool = True,
    ) -> None:
        self.twin, self.sample_rate = twin, sample_rate
        self._factor = oversampling(sample_rate)
        self._fine_rate = sample_rate * self._factor
        self._orders = _ORDERS[1:2] if pure_sine and not _needs_all(twin.drive) else _ORDERS
        self._simulation = Simulation(assemble(twin.rig, self._orders), 1 / self._fine_rate)
        self._chains = [
            SensorStream(twin.sensors.get(name, SensorChain()), sample_rate, rng) for name in twin.channels
        ]
        self._yoke = resonance(twin.rig.yoke_frequency, twin.rig.yoke_damping, self._fine_rate)
        self._lookahead = max(chain.lookahead for chain in self._chains)
        self._delivered = 0
        self._steps = 0
        self._pending: list[tuple[int, SineDrive, float, float]] = []
        self._force = _DriveForce()
        self._shapes = deflection_shapes(twin.rig, np.linspace(0, 1, _SHAPE_POINTS))

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows that `advance` gives."""
        return self.twin.channels

    def drive(self, drive: SineDrive, phase: float = 0.0, at_sample: float | None = None) -> None:
        """Change the drive at `at_sample` (fractional; default: the next one), at `phase` rad of the sine.

        Changes come in the order of their samples. What lies in the past takes effect now, in its phase.
        """
        if len(self._orders) == 1 and _needs_all(drive):
            raise ValueError("this stream was made for a pure sine")
        sample = float(self._delivered if at_sample is None else at_sample)
        self._pending.append((round(sample * self._factor), drive, phase, sample / self.sample_rate))

    def advance(self, count: int) -> Array:
        """Return the next `count` samples, shape (channels, count)."""
        self._delivered += count
        steps = self._delivered * self._factor + self._lookahead - self._steps
        if steps > 0:
            self._extend(steps)
        return np.array([chain.pull(count) for chain in self._chains])

    def shape(self) -> tuple[float, Array]:
        """Time (s) of the present state and deflection of the beam in m at 29 points from pivot to tip."""
        return self._simulation.time, self._shapes @ self._simulation.state

    def _extend(self, steps: int) -> None:
        end = self._steps + steps
        while self._steps < end:
            while self._pending and self._pending[0][0] <= self._steps:
                self._change_drive(*self._pending.pop(0)[1:])
            stop = min(end, self._pending[0][0]) if self._pending else end
            self._simulate(stop - self._steps)

    def _change_drive(self, drive: SineDrive, phase: float, reference: float) -> None:
        omega = 2 * np.pi * drive.frequency
        self._simulation.drive(drive.phasors()[list(self._orders)], omega, phase, reference)
        self._force.change(drive, phase, reference)

    def _simulate(self, steps: int) -> None:
        trace = self._simulation.advance(steps)
        upper, lower, base, *stations = trace.outputs
        times = np.asarray(trace.start + np.arange(steps) * trace.step)
        drive = self._force(times)
        truth = (drive, upper, lower, self._yoke(upper - lower), base, *stations)
        for chain, fine in zip(self._chains, truth, strict=True):
            chain.push(fine)
        self._steps += steps


class _DriveForce:
    """The coil's force over time; zero before the first change."""

    def __init__(self) -> None:
        self._drive: SineDrive | None = None
        self._phase = self._reference = 0.0

    def change(self, drive: SineDrive, phase: float, reference: float) -> None:
        self._drive, self._phase, self._reference = drive, phase, reference

    def __call__(self, times: Array) -> Array:
        if self._drive is None:
            return np.zeros_like(times)
        omega = 2 * np.pi * self._drive.frequency
        return self._drive.force(omega * (times - self._reference) + self._phase)


def _needs_all(drive: SineDrive) -> bool:
    return bool(drive.offset or drive.second or drive.third)
