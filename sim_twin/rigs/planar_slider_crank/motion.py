"""The crank's mechanism set up for the integrator: numbers, tolerances, states with given eccentricities."""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from sim_twin.contact.laws import Friction, lankarani_nikravesh
from sim_twin.joints.planar_revolute import RevoluteClearance
from sim_twin.mechanisms.run import StepLimits
from sim_twin.mechanisms.simulation import Simulation
from sim_twin.rigs.crank_drive import SpeedDrive, speed_at
from sim_twin.rigs.planar_slider_crank import kernel
from sim_twin.rigs.planar_slider_crank.kernel import PHI, THETA, VS, VX, VY, CrankNumbers, S, W, X, Y
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank

Array = NDArray[np.float64]
TOLERANCE = 1e-6
"""Error a step may make, in the units of _SCALES; first peaks within 0.01 %, at 1e-5 within 0.2 %."""
_SCALES = (0.01, 0.01, 0.01, 0.01, 10.0, 10.0, 10.0, 10.0, 1.0, 1e6, 1e6, 0.01, 10.0)
_LONGEST, _SHORTEST, _AFTER_ONSET, _REACH = 1e-3, 1e-15, 4e-6, 1e-10
STEP_BUDGET = 2_000_000
"""Steps that a call may take for each simulated second; a healthy rig takes about 1e4."""
AT_REST = SpeedDrive(0.0)


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
        gravity=rig.gravity,
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
    y = np.zeros(_states(rig))
    place(rig, y, angle, speed_at(drive, angle), at)
    return Simulation(
        kernel.run, numbers(rig, drive), y, kernel.CONTACTS, kernel.OUTPUTS, limits or step_limits(rig), step
    )


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
