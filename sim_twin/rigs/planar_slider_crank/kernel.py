"""The mechanism's equations of motion, for the integrator.

Crank driven; rod free in the plane between two joints with clearance; piston on its line. The rod may bend in
one mode sin(pi s/L) over its chord. State: x, y of the rod's centre (m), its angle (rad), the piston's x (m);
their velocities; crank angle; work of the crank pin on the rod and energy lost in contacts and friction (J);
with a flexible rod its deflection (m) and speed (m/s).
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

from sim_twin.compiled import inlined, mechanical
from sim_twin.contact import Friction, friction_share
from sim_twin.joints.planar_revolute import (
    RevoluteClearance,
    RevoluteForce,
    revolute_depth,
    revolute_force,
)
from sim_twin.joints.vectors import sine_cosine
from sim_twin.lane_array import in_lanes
from sim_twin.mechanisms.integrator import integrate
from sim_twin.mechanisms.lane_integrator import advance_lanes, begin_lanes
from sim_twin.mechanisms.lane_run import LaneRun, Lanes
from sim_twin.mechanisms.lanes import Kernel
from sim_twin.mechanisms.run import Real, Run, StepLimits
from sim_twin.vector import touches

X, Y, PHI, S, VX, VY, W, VS, THETA, WORK, LOST, Q, VQ = range(13)
RIGID_STATES, FLEXIBLE_STATES = 11, 13  # the state's length tells whether the rod bends
CRANK_PIN, PISTON_PIN = 0, 1  # places in `v0`, `d`, `rate` and `force`
CONTACTS = 2
FRAME_X, FRAME_Y, GUIDE_Y, ANGLE, PISTON_ACCELERATION = range(5)  # N, N, N, rad, m/s2
OUTPUTS = 5
_COUPLING = 4.0 / pi
"""2 m3/pi over the modal mass m3/2."""


class CrankNumbers(NamedTuple):
    """Parameters in SI; `a`, `b` reach from the rod's centre of mass to crank pin and piston pin.

    Mobilities are 1/mass and 1/inertia; `unbalance` is m2 L2/2 in kg m. Gravity is
    `gravity` towards -y and `pull` towards +x. The crank turns at
    omega (1 + fluctuation sin(order theta + lag)). `rod_omega` in rad/s and `rod_decay` = 2 zeta rod_omega
    belong to the bending mode.
    """

    crank_length: float
    a: float
    b: float
    rod_mass: float
    piston_mass: float
    rod_mobility: float
    rod_turning_mobility: float
    piston_mobility: float
    unbalance: float
    gravity: float
    pull: float
    joint_1: RevoluteClearance
    joint_2: RevoluteClearance
    guide: Friction
    omega: float
    fluctuation: float
    order: float
    lag: float
    rod_omega: float
    rod_decay: float


@inlined
def _crank_speed(p: CrankNumbers, theta: float) -> float:
    speed = p.omega
    if touches(p.fluctuation * p.fluctuation):  # spares the sine: it is asked for in every stage of a step
        speed = p.omega * (1.0 + p.fluctuation * sine_cosine(p.order * theta + p.lag)[0])
    return speed


@inlined
def _at_crank_pin(
    p: CrankNumbers, y: Real, speed: float, sine: float, cosine: float, up: float, along: float
) -> tuple[float, float, float, float]:
    """Journal's centre less bearing's (m) and its rate (m/s); sines and cosines of crank and rod."""
    return (
        p.crank_length * cosine - y[X] + p.a * along,
        p.crank_length * sine - y[Y] + p.a * up,
        -p.crank_length * speed * sine - y[VX] - p.a * y[W] * up,
        p.crank_length * speed * cosine - y[VY] + p.a * y[W] * along,
    )


@inlined
def _at_piston_pin(p: CrankNumbers, y: Real, up: float, along: float) -> tuple[float, float, float, float]:
    return (
        y[S] - y[X] - p.b * along,
        -y[Y] - p.b * up,
        y[VS] - y[VX] + p.b * y[W] * up,
        -y[VY] - p.b * y[W] * along,
    )


@inlined
def _joint_forces(
    p: CrankNumbers, y: Real, v0: Real, speed: float, sine: float, cosine: float, up: float, along: float
) -> tuple[RevoluteForce, RevoluteForce]:
    # v0 is the approach speed (m/s) that was latched at the onset of a contact; 0: the joint is open.
    no = 0.0 * v0[CRANK_PIN]  # in as many lanes as that
    one = two = RevoluteForce(no, no, no, no, no, no)
    if touches(v0[CRANK_PIN]):
        ex, ey, vx, vy = _at_crank_pin(p, y, speed, sine, cosine, up, along)
        one = revolute_force(p.joint_1, ex, ey, vx, vy, speed, y[W], v0[CRANK_PIN])
    if touches(v0[PISTON_PIN]):
        ex, ey, vx, vy = _at_piston_pin(p, y, up, along)
        two = revolute_force(p.joint_2, ex, ey, vx, vy, 0.0, y[W], v0[PISTON_PIN])  # the pin does not turn
    return one, two


@mechanical
def rates(p: CrankNumbers, t: float, y: Real, v0: Real, dy: Real, force: Real) -> None:
    """Slopes of the state and the normal forces of both joints (Newton and Euler for rod and piston)."""
    speed = _crank_speed(p, y[THETA])  # the crank's motion is given: no force changes it
    fx, fy, torque, push, lift, lost, work = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    force[CRANK_PIN], force[PISTON_PIN] = 0.0, 0.0
    if touches(max(v0[CRANK_PIN], v0[PISTON_PIN])):  # no sines in free flight
        sine, cosine = sine_cosine(y[THETA])
        up, along = sine_cosine(y[PHI])
        one, two = _joint_forces(p, y, v0, speed, sine, cosine, up, along)
        fx, fy, push, lift, lost = one.x + two.x, one.y + two.y, -two.x, two.y, one.lost + two.lost
        arms = p.a * (up * one.x - along * one.y) + p.b * (along * two.y - up * two.x)
        torque = one.on_bearing + two.on_bearing + arms
        work = speed * (p.crank_length * (cosine * one.y - sine * one.x) - one.on_journal)
        force[CRANK_PIN], force[PISTON_PIN] = one.normal, two.normal
    if touches(p.guide.coefficient):
        drag = friction_share(p.guide, y[VS]) * abs(p.piston_mass * p.gravity + lift)  # N; weight and rod
        push, lost = push + drag, lost - drag * y[VS]  # drag is against the speed, so this is a gain
    dy[X], dy[Y], dy[PHI], dy[S] = y[VX], y[VY], y[W], y[VS]
    dy[VX], dy[VY] = fx * p.rod_mobility + p.pull, fy * p.rod_mobility - p.gravity
    dy[W], dy[VS] = torque * p.rod_turning_mobility, push * p.piston_mobility + p.pull
    dy[THETA], dy[WORK], dy[LOST] = speed, work, lost
    if y.size > RIGID_STATES:
        _bend(p, y, fx, fy, dy)


@inlined
def _bend(p: CrankNumbers, y: Real, fx: float, fy: float, dy: Real) -> None:
    """Add the bending mode: q'' + 2 zeta w q' + w^2 q = -(4/pi) a, a the chord's transverse acceleration."""
    up, along = sine_cosine(y[PHI])
    a = (along * fy - up * fx) * p.rod_mobility  # no gravity: rod and mode fall alike
    decay, spring = p.rod_decay * y[VQ], p.rod_omega * p.rod_omega * y[Q]
    # The chord of the free rod gives way, and 1 - 8/pi^2 of the modal mass is left: 2.30 times the frequency.
    bend = -(decay + spring + _COUPLING * a) / (1.0 - 0.5 * _COUPLING * _COUPLING)
    dy[Q], dy[VQ] = y[VQ], bend
    dy[VX] += 0.5 * _COUPLING * bend * up  # the mode's reaction on the rod's centre
    dy[VY] -= 0.5 * _COUPLING * bend * along
    dy[LOST] += 0.5 * p.rod_mass * decay * y[VQ]  # W; the modal mass is half the rod's


@mechanical
def depths(p: CrankNumbers, t: float, y: Real, d: Real, rate: Real) -> None:
    """Penetration of both joints and its rate."""
    speed = _crank_speed(p, y[THETA])
    sine, cosine = sine_cosine(y[THETA])
    up, along = sine_cosine(y[PHI])
    # asked for open joints too: where one comes above zero a contact begins
    ex, ey, vx, vy = _at_crank_pin(p, y, speed, sine, cosine, up, along)
    d[CRANK_PIN], rate[CRANK_PIN] = revolute_depth(p.joint_1.clearance, ex, ey, vx, vy)
    ex, ey, vx, vy = _at_piston_pin(p, y, up, along)
    d[PISTON_PIN], rate[PISTON_PIN] = revolute_depth(p.joint_2.clearance, ex, ey, vx, vy)


@mechanical
def observe(p: CrankNumbers, t: float, y: Real, v0: Real, out: Real, column: int) -> None:
    """What the mechanism does to the frame (N), crank angle (rad) and piston acceleration (m/s2)."""
    sine, cosine = sine_cosine(y[THETA])
    speed = _crank_speed(p, y[THETA])
    centrifugal = p.unbalance * speed * speed  # N, along the crank; its bearing is in the frame
    frame_x, frame_y, push, lift = centrifugal * cosine, centrifugal * sine, 0.0, 0.0
    if touches(max(v0[CRANK_PIN], v0[PISTON_PIN])):
        up, along = sine_cosine(y[PHI])
        one, two = _joint_forces(p, y, v0, speed, sine, cosine, up, along)
        frame_x, frame_y, push, lift = frame_x - one.x, frame_y - one.y, -two.x, two.y
    if touches(p.guide.coefficient):
        push += friction_share(p.guide, y[VS]) * abs(p.piston_mass * p.gravity + lift)
    out[FRAME_X, column], out[FRAME_Y, column], out[GUIDE_Y, column] = frame_x, frame_y, -lift
    out[ANGLE, column], out[PISTON_ACCELERATION, column] = y[THETA], push * p.piston_mobility + p.pull


@mechanical
def run(p: CrankNumbers, state: Run, limits: StepLimits, dt: float, out: Real, episodes: Real) -> int:
    """`integrate` for this mechanism."""
    return integrate(rates, depths, observe, p, state, limits, dt, out, episodes)


@mechanical
def begin(like: CrankNumbers, table: Lanes, state: LaneRun, limits: StepLimits) -> None:
    """`begin_lanes` for this mechanism."""
    begin_lanes(rates, depths, in_lanes(table, like), state, limits)


@mechanical
def advance(
    like: CrankNumbers, table: Lanes, each: Lanes, state: LaneRun, limits: StepLimits, dt: float, first: int,
    out: Real,
) -> None:  # fmt: skip
    """`advance_lanes` for this mechanism."""
    advance_lanes(rates, depths, observe, like, table, each, state, limits, dt, first, out)


SIDE_BY_SIDE = Kernel(begin, advance, CONTACTS, OUTPUTS)
"""Eight runs of it side by side."""
