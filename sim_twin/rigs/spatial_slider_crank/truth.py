"""The true motion of the spatial slider-crank at its channels."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.mechanisms.simulation import Simulation
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after, marker_voltage
from sim_twin.rigs.spatial_slider_crank.constants import CONTACTS, Constants, constants
from sim_twin.rigs.spatial_slider_crank.kernel import ANGLE_ROW, OUTPUTS, SPEED_ROW
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
from sim_twin.rigs.spatial_slider_crank.motion import AT_REST, eccentricity, ideal_state, place, simulation
from sim_twin.rigs.spatial_slider_crank.pose import crank_pin, pose
from sim_twin.status import Status
from sim_twin.twin import Twin

Array = NDArray[np.float64]
SpatialTwin: TypeAlias = Twin[SpatialSliderCrank, SpeedDrive]


class SpatialTruth:
    """Still until the first drive, which starts it in full motion: centred joints, ideal velocities."""

    def __init__(self, twin: SpatialTwin, rate: float, drive_changes: bool = False) -> None:
        self._rig, self._rate = twin.rig, rate
        self._simulation: Simulation[Constants] | None = None
        self._steps = 0
        self._status = Status.COMPLETED

    def change_drive(self, drive: SpeedDrive, phase: float, reference: float) -> None:
        """Drive like this from now on; the crank is at `phase` rad at `reference` s.

        A crank that turns already is put to its new angle, and rod and slider with it: the ball stays where
        it is in its socket, and as fast there.
        """
        angle = angle_after(drive, phase, self._steps / self._rate - reference)
        if self._simulation is None:
            self._simulation = simulation(self._rig, drive, angle, 1 / self._rate)
            return
        p, y = constants(self._rig, drive), self._simulation.present()
        offset, rate = eccentricity(self._simulation.parameters, y)
        place(p, y, angle, offset, rate)
        self._simulation.change(p, y)

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (channels, steps); fewer after a failure."""
        outputs = self._outputs(steps)
        self._steps += outputs.shape[1]
        marker = marker_voltage(outputs[ANGLE_ROW])
        return np.array([*outputs[:CONTACTS], outputs[SPEED_ROW], marker])

    def _outputs(self, steps: int) -> Array:
        if self._simulation is None:
            return np.zeros((OUTPUTS, steps))
        trace = self._simulation.advance(steps)
        self._status = trace.status
        return trace.outputs

    def shape(self) -> Array:
        """Points in m, shape (4, 3): crank bearing, socket, ball, universal joint."""
        if self._simulation is None:
            p = constants(self._rig, AT_REST)
            y = ideal_state(p, 0.0)
        else:
            p, y = self._simulation.parameters, self._simulation.present()
        at, theta = pose(p, y), float(y[2 * (8 + 2 * p.modes)])
        return np.array([p.centre, crank_pin(p, theta), at.ball, at.pin])

    @property
    def status(self) -> Status:
        """How the integration stands."""
        return self._status
