"""The true motion of the impact beam at its channels."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.linear_filter import resonance
from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.rigs.impact_beam.structure import deflection_shapes
from sim_twin.status import Status
from sim_twin.switched.simulation import Simulation
from sim_twin.twin import Twin

Array = NDArray[np.float64]
BeamTwin: TypeAlias = Twin[ImpactBeam, SineDrive]
_ORDERS = (0, 1, 2, 3)
_SHAPE_POINTS = 29


class BeamTruth:
    """From rest; `drive_changes` makes room for a drive that gets an offset or harmonics later on."""

    def __init__(self, twin: BeamTwin, rate: float, drive_changes: bool = False) -> None:
        self._orders = _ORDERS if drive_changes or _needs_all(twin.drive) else _ORDERS[1:2]
        self._simulation = Simulation(assemble(twin.rig, self._orders), 1 / rate)
        self._yoke = resonance(twin.rig.yoke_frequency, twin.rig.yoke_damping, rate)
        self._shapes = deflection_shapes(twin.rig, np.linspace(0, 1, _SHAPE_POINTS))
        self._force: Callable[[Array], Array] = np.zeros_like  # of the coil, over time
        self._finite, self._gauged = True, twin.rig.stinger_gauge

    def change_drive(self, drive: SineDrive, phase: float, reference: float) -> None:
        """Drive like this from now on, at `phase` rad of the sine at `reference` s."""
        if len(self._orders) == 1 and _needs_all(drive):
            raise ValueError("this motion was set up for a pure sine")
        omega = 2 * np.pi * drive.frequency
        self._simulation.drive(drive.phasors()[list(self._orders)], omega, phase, reference)
        self._force = lambda times: drive.force(omega * (times - reference) + phase)

    def advance(self, steps: int) -> Array:
        trace = self._simulation.advance(steps)
        upper, lower, *accelerations = trace.outputs
        drive = self._force(np.asarray(trace.start + np.arange(steps) * trace.step))
        if self._gauged:
            drive = drive - accelerations.pop()
        self._finite = self._finite and bool(np.isfinite(self._simulation.state).all())
        return np.array([drive, upper, lower, self._yoke(upper - lower), *accelerations])

    def shape(self) -> Array:
        """Deflection of the beam in m at 29 points from pivot to tip."""
        return np.asarray(self._shapes @ self._simulation.state)

    @property
    def status(self) -> Status:
        """Diverged as soon as the state is not finite."""
        return Status.COMPLETED if self._finite else Status.DIVERGED


def _needs_all(drive: SineDrive) -> bool:
    return bool(drive.offset or drive.second or drive.third)
