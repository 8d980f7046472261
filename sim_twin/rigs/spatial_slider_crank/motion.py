"""The spatial slider-crank in motion: set up for the integrator, and what its channels show."""

from __future__ import annotations

from collections.abc import Sequence
from math import asin, atan2, sqrt
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.mechanisms.lanes import Lane, LaneSimulation
from sim_twin.mechanisms.run import StepLimits
from sim_twin.mechanisms.simulation import Simulation
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after, marker_voltage
from sim_twin.rigs.spatial_slider_crank import kernel
from sim_twin.rigs.spatial_slider_crank.constants import CONTACTS, Constants, Layout, constants, layout
from sim_twin.rigs.spatial_slider_crank.kernel import ANGLE_ROW, OUTPUTS, SPEED_ROW
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
from sim_twin.rigs.spatial_slider_crank.pose import crank_pin, crank_pin_velocity, pose
from sim_twin.status import Status
from sim_twin.twin import Twin

Array = NDArray[np.float64]
PRECISION = 1e-10
"""m; error that a step may make in a place: first peaks within 0.2 %."""
_RATE, _ENERGY = 1e4, 1e3
_LONGEST, _SHORTEST, _AFTER_ONSET, _REACH = 1e-3, 1e-15, 4e-6, 1e-10
_FLOOR = 1e-9
"""m/s; the linear law has no use for the approach speed, which only marks that a contact touches."""
STEP_BUDGET = 4_000_000
"""Steps that a call may take for each simulated second; a healthy rig takes about 3e4."""
_NEWTON = 8
AT_REST = SpeedDrive(0.0)
SpatialTwin: TypeAlias = Twin[SpatialSliderCrank, SpeedDrive]


def simulation(
    rig: SpatialSliderCrank, drive: SpeedDrive, angle: float, step: float, limits: StepLimits | None = None
) -> Simulation[Constants]:
    """From ideal joints at crank `angle` rad and t = 0 on, sampled every `step` s."""
    p = constants(rig, drive)
    y = ideal_state(p, angle)
    limits = limits or step_limits(rig)
    return Simulation(kernel.run, p, y, CONTACTS, kernel.OUTPUTS, limits, step)


def step_limits(
    rig: SpatialSliderCrank, precision: float = PRECISION, budget: int = STEP_BUDGET
) -> StepLimits:
    """Steps that err by `precision` m at every place alike, and by that in 0.1 ms of its speed."""
    where, rod = _layout(constants(rig, AT_REST)), rig.rod
    n = where.speeds
    tolerance = np.full(where.size, precision)
    tolerance[3:6] /= rig.contact_span
    tolerance[6:8] /= rod.length
    tolerance[8:n] *= sqrt(rod.mass) / 2
    tolerance[n : 2 * n] = _RATE * tolerance[:n]
    tolerance[n + 3 : n + 6] = _RATE * precision / rod.length
    tolerance[where.theta] /= rig.crank_radius
    tolerance[where.work : where.base] *= _ENERGY
    tolerance[where.base + 2 :] *= _RATE
    return StepLimits(tolerance, _LONGEST, _SHORTEST, _AFTER_ONSET, _FLOOR, _REACH, budget)


def ideal_state(p: Constants, angle: float) -> Array:
    """Slider and ball centred, nothing bent, the velocities of ideal joints at crank `angle` rad."""
    where = _layout(p)
    y = np.zeros(where.size)
    across = np.array(crank_pin(p, angle)) - p.centre
    along = sqrt(p.rod_length**2 - across[1] ** 2 - across[2] ** 2)
    y[0], y[1], y[2] = across[0] + along, p.centre[1], p.centre[2]
    y[6], y[7] = atan2(across[2], along), asin(-across[1] / p.rod_length)
    place(p, y, angle, np.zeros(3), np.zeros(3))
    return y


def eccentricity(p: Constants, y: Array) -> tuple[Array, Array]:
    """The ball's centre less the socket's, m and m/s, shapes (3,)."""
    at, angle = pose(p, y), float(y[_layout(p).theta])
    offset = np.array(at.ball) - crank_pin(p, angle)
    return offset, np.array(at.ball_velocity) - crank_pin_velocity(p, angle)


def place(p: Constants, y: Array, angle: float, offset: Array, rate: Array) -> None:
    """Put the crank to `angle` rad and the ball `offset` m off the socket's centre, at `rate` m/s there.

    The slider goes along the guide and the joint turns; slider's other places and the bending stay.
    """
    where = _layout(p)
    n = where.speeds
    y[where.theta] = angle
    for _ in range(_NEWTON):
        miss = np.array(crank_pin(p, angle)) + offset - pose(p, y).ball
        y[[0, 6, 7]] += np.linalg.solve(_ball_steps(p, y), miss)
    y[n : n + 8] = 0.0
    miss = np.array(crank_pin_velocity(p, angle)) + rate - pose(p, y).ball_velocity
    along, alpha, beta = np.linalg.solve(_ball_steps(p, y), miss)
    y[n], y[n + 6], y[n + 7] = along, alpha, beta
    y[n + 3 : n + 6] = alpha * np.array(pose(p, y).axis) + [0.0, 0.0, beta]


def _ball_steps(p: Constants, y: Array) -> Array:
    """How the ball moves with pin along the guide, alpha and beta: columns, shape (3, 3)."""
    at = pose(p, y)
    arm = np.array(at.ball) - at.pin
    about_y, about_z = np.array(at.slider)[:, 1], np.array(at.rod)[:, 2]
    return np.column_stack([[1.0, 0.0, 0.0], np.cross(about_y, arm), np.cross(about_z, arm)])


def _layout(p: Constants) -> Layout:
    return layout(p.modes, bool(p.base[1] > 0.0))


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
        outputs = np.zeros((OUTPUTS, steps))
        if self._simulation is not None:
            trace = self._simulation.advance(steps)
            outputs, self._status = trace.outputs, trace.status
        self._steps += outputs.shape[1]
        return _shown(self._rig, outputs)

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
        return self._status


class SpatialTruths:
    """Rows as in `SpatialTruth`, for all twins."""

    def __init__(self, twins: Sequence[SpatialTwin], phases: Sequence[float], rate: float) -> None:
        self._rigs, lanes = [twin.rig for twin in twins], []
        for twin, phase in zip(twins, phases, strict=True):
            p = constants(twin.rig, twin.drive)
            lanes.append(Lane(p, ideal_state(p, angle_after(twin.drive, phase, 0.0)), step_limits(twin.rig)))
        self._simulation = LaneSimulation(kernel.SIDE_BY_SIDE, lanes, 1 / rate)

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (twins, channels, steps)."""
        outputs = self._simulation.advance(steps)
        return np.array([_shown(rig, each) for rig, each in zip(self._rigs, outputs, strict=True)])

    @property
    def statuses(self) -> Sequence[Status]:
        return self._simulation.statuses


def _shown(rig: SpatialSliderCrank, outputs: Array) -> Array:
    """What the channels show of what a simulation puts out, shape (channels, n)."""
    marker = marker_voltage(outputs[ANGLE_ROW] - rig.marker_angle)
    return np.array([*outputs[:CONTACTS], outputs[SPEED_ROW], marker])
