"""The planar slider-crank in motion: set up for the integrator, its frame, and what its channels show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, cos, pi, sin
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.contact import Friction, lankarani_nikravesh
from sim_twin.joints.planar_revolute import RevoluteClearance
from sim_twin.linear_filter import LinearFilter, oscillator
from sim_twin.mechanisms.lanes import Lane, LaneSimulation
from sim_twin.mechanisms.run import StepLimits
from sim_twin.mechanisms.simulation import Simulation
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after, marker_voltage, speed_at
from sim_twin.rigs.planar_slider_crank import kernel
from sim_twin.rigs.planar_slider_crank.channels import CRANK_X, CRANK_Y, PISTON_Y
from sim_twin.rigs.planar_slider_crank.kernel import (
    ANGLE,
    FRAME_X,
    FRAME_Y,
    GUIDE_Y,
    OUTPUTS,
    PHI,
    THETA,
    VS,
    VX,
    VY,
    CrankNumbers,
    S,
    W,
    X,
    Y,
)
from sim_twin.rigs.planar_slider_crank.model import FrameMode, PlanarSliderCrank
from sim_twin.status import Status
from sim_twin.twin import Twin

Array = NDArray[np.float64]
TOLERANCE = 1e-6
"""Error a step may make, in the units of _SCALES; first peaks within 0.01 %, at 1e-5 within 0.2 %."""
_SCALES = (0.01, 0.01, 0.01, 0.01, 10.0, 10.0, 10.0, 10.0, 1.0, 1e6, 1e6, 0.01, 10.0)
_LONGEST, _SHORTEST, _AFTER_ONSET, _REACH = 1e-3, 1e-15, 4e-6, 1e-10
STEP_BUDGET = 2_000_000
"""Steps that a call may take for each simulated second; a healthy rig takes about 1e4."""
AT_REST = SpeedDrive(0.0)
CrankTwin: TypeAlias = Twin[PlanarSliderCrank, SpeedDrive]


def frame_acceleration(mode: FrameMode, rate: float) -> LinearFilter:
    """Acceleration in m/s2 of an oscillator at rest, from the force on it in N, sampled at `rate` Hz."""
    omega = 2 * pi * mode.frequency
    decay = 2 * mode.damping_ratio * omega
    return oscillator(omega, decay, 1 / mode.mass, (-(omega**2), -decay), 1 / mode.mass, rate)


class Frames:
    """The rig's frame, from rest on: accelerations in m/s2 by channel, from what a simulation puts out."""

    def __init__(self, rig: PlanarSliderCrank, rate: float) -> None:
        self._filters = {name: frame_acceleration(mode, rate) for name, mode in rig.frames.items()}

    def __call__(self, outputs: Array) -> dict[str, Array]:
        """For the next `outputs`, shape (outputs, n); each of shape (n,)."""
        forces = {CRANK_Y: outputs[FRAME_Y], CRANK_X: outputs[FRAME_X], PISTON_Y: outputs[GUIDE_Y]}
        return {name: self._filters[name](force) for name, force in forces.items()}


class Shown:
    """What the rig's channels show, rows in their order, of what a simulation puts out from rest on."""

    def __init__(self, rig: PlanarSliderCrank, rate: float) -> None:
        self._frames, self._marker = Frames(rig, rate), rig.marker_angle

    def __call__(self, outputs: Array) -> Array:
        """For the next `outputs`, shape (outputs, n); shape (channels, n)."""
        marker = marker_voltage(outputs[ANGLE] - self._marker)
        return np.array([*self._frames(outputs).values(), outputs[ANGLE], marker])


@dataclass(frozen=True, slots=True)
class Eccentricity:
    """Journal's centre less bearing's at both joints, `x`, `y` in m and their rates in m/s, shapes (2,)."""

    x: Array
    y: Array
    vx: Array
    vy: Array


CENTRED = Eccentricity(np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2))


def numbers(rig: PlanarSliderCrank, drive: SpeedDrive) -> CrankNumbers:
    """The parameters as the kernel takes them."""
    friction = Friction(rig.friction, rig.friction_v_0, rig.friction_v_1)
    joint_1, joint_2 = (
        RevoluteClearance(c, rig.journal_radius, lankarani_nikravesh(K, rig.restitution), friction)
        for c, K in zip((rig.clearance_1, rig.clearance_2), rig.contact_stiffnesses, strict=True)
    )
    a = rig.rod_centre * rig.rod_length
    rod_omega = 2 * pi * rig.bending.frequency if rig.bending else 0.0
    return CrankNumbers(
        crank_length=rig.crank_length,
        a=a,
        b=rig.rod_length - a,
        rod_mass=rig.rod_mass,
        piston_mass=rig.piston_mass,
        rod_mobility=1 / rig.rod_mass,
        rod_turning_mobility=1 / rig.rod_inertia,
        piston_mobility=1 / rig.piston_mass,
        unbalance=rig.crank_mass * rig.crank_centre * rig.crank_length,
        gravity=rig.gravity * cos(rig.incline),
        pull=rig.gravity * sin(rig.incline),
        joint_1=joint_1,
        joint_2=joint_2,
        guide=Friction(rig.guide_friction, 0.0, rig.guide_v_1),
        omega=drive.speed,
        fluctuation=drive.fluctuation,
        order=float(drive.order),
        lag=drive.phase,
        rod_omega=rod_omega,
        rod_decay=2 * rig.bending.damping_ratio * rod_omega if rig.bending else 0.0,
    )


def step_limits(
    rig: PlanarSliderCrank, tolerance: float = TOLERANCE, budget: int = STEP_BUDGET
) -> StepLimits:
    """How finely to integrate; `tolerance` as at TOLERANCE."""
    scales = np.array(_SCALES[: _states(rig)])
    return StepLimits(
        tolerance * scales, _LONGEST, _SHORTEST, _AFTER_ONSET, rig.approach_floor, _REACH, budget
    )


def simulation(
    rig: PlanarSliderCrank, drive: SpeedDrive, angle: float, step: float, limits: StepLimits | None = None,
    at: Eccentricity = CENTRED,
) -> Simulation[CrankNumbers]:  # fmt: skip
    """In full motion from crank `angle` rad at t = 0 on, sampled every `step` s."""
    y = _state(rig, drive, angle, at)
    return Simulation(
        kernel.run, numbers(rig, drive), y, kernel.CONTACTS, kernel.OUTPUTS, limits or step_limits(rig), step
    )


def _state(rig: PlanarSliderCrank, drive: SpeedDrive, angle: float, at: Eccentricity = CENTRED) -> Array:
    y = np.zeros(_states(rig))
    place(rig, y, angle, speed_at(drive, angle), at)
    return y


def place(rig: PlanarSliderCrank, y: Array, angle: float, speed: float, at: Eccentricity) -> None:
    """Put the mechanism at crank `angle` rad and `speed` rad/s, with the eccentricities `at`."""
    r, L, a = rig.crank_length, rig.rod_length, rig.rod_centre * rig.rod_length
    px, py = r * cos(angle) - at.x[0], r * sin(angle) - at.y[0]
    vpx, vpy = -r * speed * sin(angle) - at.vx[0], r * speed * cos(angle) - at.vy[0]
    phi = asin((-at.y[1] - py) / L)
    w = (-at.vy[1] - vpy) / (L * cos(phi))
    y[THETA], y[PHI], y[W] = angle, phi, w
    y[X], y[Y], y[S] = px + a * cos(phi), py + a * sin(phi), px + L * cos(phi) + at.x[1]
    y[VX], y[VY] = vpx - a * w * sin(phi), vpy + a * w * cos(phi)
    y[VS] = vpx - L * w * sin(phi) + at.vx[1]


def eccentricity(rig: PlanarSliderCrank, y: Array, speed: float) -> Eccentricity:
    """Where the journals are in their bearings in state `y`, the crank turning at `speed` rad/s."""
    r, a = rig.crank_length, rig.rod_centre * rig.rod_length
    b, along, up, w = rig.rod_length - a, cos(y[PHI]), sin(y[PHI]), y[W]
    cosine, sine = cos(y[THETA]), sin(y[THETA])
    return Eccentricity(
        np.array([r * cosine - y[X] + a * along, y[S] - y[X] - b * along]),
        np.array([r * sine - y[Y] + a * up, -y[Y] - b * up]),
        np.array([-r * speed * sine - y[VX] - a * w * up, y[VS] - y[VX] + b * w * up]),
        np.array([r * speed * cosine - y[VY] + a * w * along, -y[VY] - b * w * along]),
    )


def _states(rig: PlanarSliderCrank) -> int:
    return kernel.FLEXIBLE_STATES if rig.bending else kernel.RIGID_STATES


class CrankTruth:
    """Still until the first drive, which starts it in full motion: centred joints, ideal velocities."""

    def __init__(self, twin: CrankTwin, rate: float, drive_changes: bool = False) -> None:
        self._rig, self._rate = twin.rig, rate
        self._drive = AT_REST
        self._simulation: Simulation[CrankNumbers] | None = None
        self._shown = Shown(twin.rig, rate)
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
        outputs = np.zeros((OUTPUTS, steps))
        if self._simulation is not None:
            trace = self._simulation.advance(steps)
            outputs, self._status = trace.outputs, trace.status
        self._steps += outputs.shape[1]
        return self._shown(outputs)

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
        return self._status


class CrankTruths:
    """Rows as in `CrankTruth`, for all twins."""

    def __init__(self, twins: Sequence[CrankTwin], phases: Sequence[float], rate: float) -> None:
        lanes = []
        for twin, phase in zip(twins, phases, strict=True):
            rig, drive = twin.rig, twin.drive
            y = _state(rig, drive, angle_after(drive, phase, 0.0))
            lanes.append(Lane(numbers(rig, drive), y, step_limits(rig)))
        self._simulation = LaneSimulation(kernel.SIDE_BY_SIDE, lanes, 1 / rate)
        self._shown = [Shown(twin.rig, rate) for twin in twins]

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (twins, channels, steps)."""
        outputs = self._simulation.advance(steps)
        return np.array([shown(each) for shown, each in zip(self._shown, outputs, strict=True)])

    @property
    def statuses(self) -> Sequence[Status]:
        return self._simulation.statuses
