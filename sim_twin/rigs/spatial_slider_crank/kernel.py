"""The spatial slider-crank for the integrator: rates, depths, outputs; compiled."""

from __future__ import annotations

from sim_twin.compiled import compiled, mechanical
from sim_twin.contact import contact_forces
from sim_twin.joints.spatial import POINTS, Touch, ball_in_socket, face_axis, face_side, friction_force
from sim_twin.joints.vectors import Vector, added, cross, dot, gibbs_rate, outward, scaled, subtracted
from sim_twin.lane_array import in_lanes
from sim_twin.mechanisms.integrator import integrate
from sim_twin.mechanisms.lane_integrator import advance_lanes, begin_lanes
from sim_twin.mechanisms.lane_run import LaneRun, Lanes
from sim_twin.mechanisms.lanes import Kernel
from sim_twin.mechanisms.run import Real, Run, StepLimits
from sim_twin.rigs.spatial_slider_crank.constants import CONTACTS, RIGID, SOCKET, Array, Constants
from sim_twin.rigs.spatial_slider_crank.dynamics import (
    add_rod_load,
    add_slider,
    add_slider_load,
    elastic_forces,
    set_rod,
    solve,
)
from sim_twin.rigs.spatial_slider_crank.pose import (
    Pose,
    crank_pin,
    crank_pin_velocity,
    crank_speed,
    pose,
    slider_point,
    to_rod,
)
from sim_twin.vector import touches

SPEED_ROW, ANGLE_ROW, SLIDER_SPEED_ROW = CONTACTS, CONTACTS + 1, CONTACTS + 2  # rad/s, rad, m/s
OUTPUTS = CONTACTS + 3  # first the forces of the eight points and the socket, N


@mechanical
def rates(p: Constants, t: float, y: Array, v0: Array, dy: Array, force: Array) -> None:
    """dy/dt, and the normal forces of the eight points and the socket."""
    n = RIGID + 2 * p.modes  # coordinates; as many speeds follow, then angle, work and loss (`Layout`)
    at = pose(p, y)
    push, twist, lost = _guide_forces(p, y, at, v0, force, dy)
    ball_force, work, socket_lost = _socket_force(p, y, at, v0, force)
    in_rod = to_rod(at, ball_force)  # all equations are in the rod's frame
    elastic_forces(p, y, at, in_rod, dy)  # first: `set_rod` sums what it leaves in dy
    set_rod(p, y, at, dy, p.work)
    add_slider(p, at, p.work)
    add_rod_load(in_rod, at.tip, p.work)  # the ball sits at the bent rod's tip
    add_slider_load(at, to_rod(at, push), to_rod(at, twist), p.work)
    solve(p.work)  # the last row, loads so far, becomes accelerations
    _write_accelerations(p, y, at, p.work, dy)
    dy[2 * n] = crank_speed(p, y[2 * n])
    dy[2 * n + 1] = work
    modal_loss, m = 0.0, p.modes
    for k in range(m):
        u_rate, w_rate = y[n + RIGID + k], y[n + RIGID + m + k]
        modal_loss += 2.0 * p.damping * p.omega[k] * (u_rate * u_rate + w_rate * w_rate)  # modal mass 1
    dy[2 * n + 2] = lost + socket_lost + modal_loss


@mechanical
def depths(p: Constants, t: float, y: Array, d: Array, rate: Array) -> None:
    """Penetration and its rate at the eight points and in the socket."""
    at = pose(p, y)
    for i in range(POINTS):  # open ones too: this is what finds an onset
        place, velocity = slider_point(at, (p.points[i, 0], p.points[i, 1], p.points[i, 2]))
        d[i], rate[i] = _overlap(p, y, i, place, velocity)
    touch = _socket_touch(p, y, at)
    d[SOCKET], rate[SOCKET] = touch.depth, touch.rate


@mechanical
def observe(p: Constants, t: float, y: Array, v0: Array, out: Array, column: int) -> None:
    """Forces of points and socket (N), crank speed (rad/s) and angle (rad), slider speed (m/s) to `out`."""
    at = pose(p, y)
    for i in range(POINTS):
        out[i, column] = 0.0
        if touches(v0[i]):  # latched approach speed, m/s; 0: open
            place, velocity = slider_point(at, (p.points[i, 0], p.points[i, 1], p.points[i, 2]))
            d, rate = _overlap(p, y, i, place, velocity)
            out[i, column], _ = contact_forces(p.guide_law, d, rate, v0[i])
    out[SOCKET, column] = 0.0
    if touches(v0[SOCKET]):
        touch = _socket_touch(p, y, at)
        out[SOCKET, column], _ = contact_forces(p.socket_law, touch.depth, touch.rate, v0[SOCKET])
    theta = y[2 * (RIGID + 2 * p.modes)]
    out[SPEED_ROW, column], out[ANGLE_ROW, column] = crank_speed(p, theta), theta
    _, centre_velocity = slider_point(at, (-p.pin[0], -p.pin[1], -p.pin[2]))  # `pin` is seen from the centre
    out[SLIDER_SPEED_ROW, column] = centre_velocity[0]


@compiled
def run(p: Constants, state: Run, limits: StepLimits, dt: float, out: Real, episodes: Real) -> int:
    """Fill `out` (12, count) with the next samples; see `integrate`."""
    return integrate(rates, depths, observe, p, state, limits, dt, out, episodes)


@compiled
def begin(like: Constants, table: Lanes, state: LaneRun, limits: StepLimits) -> None:
    """See `begin_lanes`."""
    begin_lanes(rates, depths, in_lanes(table, like), state, limits)


@compiled
def advance(
    like: Constants, table: Lanes, each: Lanes, state: LaneRun, limits: StepLimits, dt: float, first: int,
    out: Real,
) -> None:  # fmt: skip
    """Fill `out` (8, 12, count + SPARE) with the next samples of eight runs; see `advance_lanes`."""
    advance_lanes(rates, depths, observe, like, table, each, state, limits, dt, first, out)


SIDE_BY_SIDE = Kernel(begin, advance, CONTACTS, OUTPUTS)
"""Eight runs of it side by side."""


@mechanical
def _overlap(p: Constants, y: Array, i: int, place: Vector, velocity: Vector) -> tuple[float, float]:
    """Penetration of point `i` of the shell into the guide, and its rate."""
    axis, side = face_axis(i), face_side(i)
    along, speed = (place[1], velocity[1]) if axis == 1 else (place[2], velocity[2])
    if touches(p.base[1]):
        base = 2 * (RIGID + 2 * p.modes) + 3
        along, speed = along - y[base + axis - 1], speed - y[base + 1 + axis]  # axis is 1 or 2
    # The shell is around the guide: a point touches where it comes nearer to the axis than the guide's face.
    return p.half_side - side * along, -side * speed


@mechanical
def _guide_forces(
    p: Constants, y: Array, at: Pose, v0: Array, force: Array, dy: Array
) -> tuple[Vector, Vector, float]:
    """Force on the slider, its moment about the pin (world frame), what contacts lose (W); moves the base."""
    push = twist = base_velocity = (0.0, 0.0, 0.0)
    lost = 0.0
    if touches(p.base[1]):  # mass 0: the guide stands still and has no states
        base = 2 * (RIGID + 2 * p.modes) + 3
        base_velocity = (0.0, y[base + 2], y[base + 3])
    for i in range(POINTS):
        force[i] = 0.0
        if touches(v0[i]):
            place, velocity = slider_point(at, (p.points[i, 0], p.points[i, 1], p.points[i, 2]))
            d, rate = _overlap(p, y, i, place, velocity)
            force[i], elastic = contact_forces(p.guide_law, d, rate, v0[i])
            slip = subtracted(velocity, base_velocity)  # across the face too: friction leaves that out
            rubbing = friction_force(p.friction, force[i], face_axis(i), slip)
            normal = face_side(i) * force[i]
            total = added(rubbing, (0.0, normal, 0.0) if face_axis(i) == 1 else (0.0, 0.0, normal))
            push = added(push, total)
            twist = added(twist, cross(subtracted(place, at.pin), total))
            lost += (force[i] - elastic) * rate - dot(rubbing, slip)
    if touches(p.base[1]):
        lost += _move_base(p, y, push, dy)
    return push, twist, lost


@mechanical
def _move_base(p: Constants, y: Array, push: Vector, dy: Array) -> float:
    """The guide on its springs under the reaction to `push`; returns what its dampers take (W)."""
    base = 2 * (RIGID + 2 * p.modes) + 3
    omega, mass, zeta = p.base[0], p.base[1], p.base[2]
    for axis in range(2):
        load = push[1] if axis == 0 else push[2]
        place, speed = y[base + axis], y[base + 2 + axis]
        dy[base + axis] = speed
        dy[base + 2 + axis] = -load / mass - omega * (omega * place + 2.0 * zeta * speed)
    squares = y[base + 2] * y[base + 2] + y[base + 3] * y[base + 3]
    return float(2.0 * zeta * omega * mass * squares)


@mechanical
def _socket_touch(p: Constants, y: Array, at: Pose) -> Touch:
    theta = y[2 * (RIGID + 2 * p.modes)]
    centre, velocity = crank_pin(p, theta), crank_pin_velocity(p, theta)  # the crank carries the socket
    return ball_in_socket(at.ball, at.ball_velocity, centre, velocity, p.socket_clearance)


@mechanical
def _socket_force(p: Constants, y: Array, at: Pose, v0: Array, force: Array) -> tuple[Vector, float, float]:
    """Force on the ball (N, world frame), the motor's power and what the contact loses (W)."""
    force[SOCKET] = 0.0
    if not touches(v0[SOCKET]):
        return (0.0, 0.0, 0.0), 0.0, 0.0
    touch = _socket_touch(p, y, at)
    F, elastic = contact_forces(p.socket_law, touch.depth, touch.rate, v0[SOCKET])
    force[SOCKET] = F
    push = scaled(F, touch.normal)
    power = dot(push, crank_pin_velocity(p, y[2 * (RIGID + 2 * p.modes)]))
    return push, power, (F - elastic) * touch.rate


@mechanical
def _write_accelerations(p: Constants, y: Array, at: Pose, A: Array, dy: Array) -> None:
    """Rates of the coordinates and, from the solved equations, of their speeds."""
    m = p.modes
    n = RIGID + 2 * m
    turning = gibbs_rate((y[3], y[4], y[5]), at.omega)
    acceleration = outward(at.rod, (A[8, 0], A[8, 1], A[8, 2]))
    for i in range(3):
        dy[i] = y[n + i]
        dy[3 + i] = turning[i]
        dy[n + i] = acceleration[i] + p.gravity[i]  # the equations are of a frame that falls
        dy[n + 3 + i] = A[8, 3 + i]
    for j in range(2):
        dy[6 + j], dy[n + 6 + j] = y[n + 6 + j], A[8, 6 + j]
    a2, a3, spin = A[8, 1], A[8, 2], A[8, 3]
    for k in range(m):  # what `elastic_forces` left out: the pin's and the spin's acceleration
        u, w = RIGID + k, RIGID + m + k
        dy[u], dy[w] = y[n + u], y[n + w]
        dy[n + u] += y[w] * spin - p.sway[k] * a2
        dy[n + w] -= y[u] * spin + p.sway[k] * a3
