"""The true motion of the planar slider-crank at its channels."""

from __future__ import annotations

from math import cos, sin
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.mechanisms.simulation import Simulation
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after, marker_voltage, speed_at
from sim_twin.rigs.planar_slider_crank.channels import CRANK_X, CRANK_Y, PISTON_Y
from sim_twin.rigs.planar_slider_crank.frame import frame_acceleration
from sim_twin.rigs.planar_slider_crank.kernel import (
    ANGLE,
    FRAME_X,
    FRAME_Y,
    GUIDE_Y,
    OUTPUTS,
    PHI,
    THETA,
    CrankNumbers,
    S,
    X,
    Y,
)
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.planar_slider_crank.motion import AT_REST, eccentricity, numbers, place, simulation
from sim_twin.status import Status
from sim_twin.twin import Twin

Array = NDArray[np.float64]
CrankTwin: TypeAlias = Twin[PlanarSliderCrank, SpeedDrive]


class CrankTruth:
    """Still until the first drive, which starts it in full motion: centred joints, ideal velocities."""

    def __init__(self, twin: CrankTwin, rate: float, drive_changes: bool = False) -> None:
        self._rig, self._rate = twin.rig, rate
        self._drive = AT_REST
        self._simulation: Simulation[CrankNumbers] | None = None
        self._frames = {name: frame_acceleration(mode, rate) for name, mode in twin.rig.frames.items()}
        self._steps = 0
        self._status = Status.COMPLETED

    def change_drive(self, drive: SpeedDrive, phase: float, reference: float) -> None:
        """Drive like this from now on; the crank is at `phase` rad at `reference` s.

        A crank that turns already is put to its new angle, and rod and piston with it: the journals stay
        where they are in their bearings, and as fast there.
        """
        angle = angle_after(drive, phase, self._steps / self._rate - reference)
        if self._simulation is None:
            self._simulation = simulation(self._rig, drive, angle, 1 / self._rate)
        else:
            y = self._simulation.present()
            at = eccentricity(self._rig, y, speed_at(self._drive, y[THETA]))
            place(self._rig, y, angle, speed_at(drive, angle), at)
            self._simulation.change(numbers(self._rig, drive), y)
        self._drive = drive

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (channels, steps); fewer after a failure."""
        outputs = self._outputs(steps)
        self._steps += outputs.shape[1]
        forces = {CRANK_Y: outputs[FRAME_Y], CRANK_X: outputs[FRAME_X], PISTON_Y: outputs[GUIDE_Y]}
        accelerations = [self._frames[name](force) for name, force in forces.items()]
        return np.array([*accelerations, outputs[ANGLE], marker_voltage(outputs[ANGLE])])

    def _outputs(self, steps: int) -> Array:
        if self._simulation is None:
            return np.zeros((OUTPUTS, steps))
        trace = self._simulation.advance(steps)
        self._status = trace.status
        return trace.outputs

    def shape(self) -> Array:
        """Points in m, shape (5, 2): crank bearing, crank pin, both ends of the rod, piston pin."""
        rig = self._rig
        if self._simulation is None:
            y = simulation(rig, AT_REST, 0.0, 1 / self._rate).present()
        else:
            y = self._simulation.present()
        r, a = rig.crank_length, rig.rod_centre * rig.rod_length
        b, along, up = rig.rod_length - a, cos(y[PHI]), sin(y[PHI])
        return np.array(
            [
                [0.0, 0.0],
                [r * cos(y[THETA]), r * sin(y[THETA])],
                [y[X] - a * along, y[Y] - a * up],
                [y[X] + b * along, y[Y] + b * up],
                [y[S], 0.0],
            ]
        )

    @property
    def status(self) -> Status:
        """How the integration stands."""
        return self._status
