"""Slider and rod as two free bodies, joined by the universal joint's forces; compiled.

Each body has a place, a quaternion and its own velocities (Newton and Euler, in the body's axes; the rod
about its middle, with its bending). The universal joint is three forces and a torque, solved for together
with the accelerations; what the steps let it drift is pulled back. Fixed steps of the classical Runge-Kutta
method are cut where a contact closes or opens. All in one file, by which numba
knows whether it has changed.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from benchmarks.blind.finite_elements import Array
from benchmarks.blind.spatial.vectors import (
    Matrix,
    Vector,
    compiled,
    cross,
    dot,
    minus,
    plus,
    rotation,
    solve_joint,
    solve_lower,
    three,
    times,
    to_body,
    to_world,
)

GUIDE_POINTS, SOCKET, CONTACTS = 8, 8, 9
# Places in a state: slider's centre 0-2 and quaternion 3-6, rod's middle 7-9 and quaternion 10-13, bending.
SLIDER, SLIDER_TURN, ROD, ROD_TURN, BEND = 0, 3, 7, 10, 14
# From `speeds_at`: slider's velocity (world) and turning (its axes), the rod's likewise, bending rates.
TURNING, ROD_VELOCITY, ROD_TURNING, BEND_RATE = 3, 6, 9, 12
# From `rest_at`: crank angle, guide's y and z, their rates, the motor's work in J.
ANGLE, BASE, BASE_RATE, WORK, REST = 0, 1, 3, 5, 6
OUTPUTS = CONTACTS + 3
_PULL = 1000.0  # 1/s, at which a drift of the joint fades
_BALL_RADIUS = 6e-3
_RAMP = (1e-4, 1e-3)  # m/s
_SECTIONS, _CUTS = 12, 40
_NEAR = 1e-13  # m


class Numbers(NamedTuple):
    """The rig in numbers, SI; `omega` to `swing` as in `Bending`, for the u of each mode and then its w.

    `contacts` (9, 3): stiffness, damping, exponent of the points and the socket. `points` (8, 3) from the
    slider's centre. `friction`: coefficient, more at rest, fading in m/s. `base`: mass (0: none), stiffness,
    damping. `drive`: speed, amplitude, order, phase. `passive`: socket friction, film, drag, spring, where
    the spring rests. `toward`: the crank's way at angle 0.
    """

    omega: Array
    loss: Array
    tip: Array
    sway: Array
    swing: Array
    half_length: float
    rod_mass: float
    rod_inertia: Array
    slider_mass: float
    slider_inertia: Array
    pin: Array
    points: Array
    half_side: float
    clearance: float
    contacts: Array
    friction: Array
    base: Array
    drive: Array
    passive: Array
    radius: float
    toward: Array
    centre: Array
    gravity: Array


class Scratch(NamedTuple):
    """Room for a step: slopes (4, n), trial states, equations of rod (6, 6), right sides (5, 6), joint."""

    slopes: Array
    trial: Array
    after: Array
    rod: Array
    sides: Array
    joint: Array
    rows: Array
    gap: Array
    gap_after: Array
    force: Array


@compiled
def speeds_at(p: Numbers) -> int:
    """Where velocities begin."""
    return BEND + len(p.omega)


@compiled
def rest_at(p: Numbers) -> int:
    """Where crank, guide and work begin."""
    return BEND + 12 + 2 * len(p.omega)


@compiled
def crank_speed(p: Numbers, angle: float) -> float:
    """rad/s."""
    return float(p.drive[0] * (1 + p.drive[1] * sin(p.drive[2] * angle + p.drive[3])))


@compiled
def _pin(p: Numbers, angle: float) -> tuple[Vector, Vector]:
    """The socket's centre and its velocity."""
    c, s, speed = p.radius * cos(angle), p.radius * sin(angle), crank_speed(p, angle)
    at = (p.centre[0] + c * p.toward[0], p.centre[1] + c * p.toward[1], p.centre[2] + s)
    return at, times(speed, (-s * p.toward[0], -s * p.toward[1], c))


@compiled
def _ball(p: Numbers, y: Array) -> tuple[Vector, Vector, Vector]:
    """The ball from the rod's middle in the rod's axes, its place and velocity."""
    v, m = speeds_at(p), len(p.omega) // 2
    u = w = u_rate = w_rate = 0.0
    for k in range(m):
        u += p.tip[k] * y[BEND + k]
        w += p.tip[m + k] * y[BEND + m + k]
        u_rate += p.tip[k] * y[v + BEND_RATE + k]
        w_rate += p.tip[m + k] * y[v + BEND_RATE + m + k]
    R, arm = rotation(y, ROD_TURN), (-p.half_length, u, w)
    turned = plus(cross(three(y, v + ROD_TURNING), arm), (0.0, u_rate, w_rate))
    return (
        arm,
        plus(three(y, ROD), to_world(R, arm)),
        plus(three(y, v + ROD_VELOCITY), to_world(R, turned)),
    )


@compiled
def _in_socket(p: Numbers, y: Array) -> tuple[float, float, Vector, Vector]:
    """Depth, its rate, the outward direction, the ball's velocity against the socket's."""
    _, place, velocity = _ball(p, y)
    centre, moving = _pin(p, y[rest_at(p) + ANGLE])
    off, slip = minus(place, centre), minus(velocity, moving)
    far = sqrt(dot(off, off))
    out = times(1 / max(far, 1e-15), off)
    return far - p.clearance, dot(slip, out), out, slip


@compiled
def _at_point(p: Numbers, y: Array, i: int, R: Matrix) -> tuple[float, float, Vector, Vector]:
    """Depth and its rate at point `i`, its place from the slider's centre (world), its slip on the guide."""
    v, base = speeds_at(p), rest_at(p) + BASE
    at = (p.points[i, 0], p.points[i, 1], p.points[i, 2])
    arm = to_world(R, at)
    velocity = plus(three(y, v), to_world(R, cross(three(y, v + TURNING), at)))
    slip = (velocity[0], velocity[1] - y[base + 2], velocity[2] - y[base + 3])
    side = 1.0 - 2.0 * (i % 2)
    if i % 4 < 2:
        return p.half_side - side * (y[1] + arm[1] - y[base]), -side * slip[1], arm, slip
    return p.half_side - side * (y[2] + arm[2] - y[base + 1]), -side * slip[2], arm, slip


@compiled
def _press(p: Numbers, i: int, depth: float, rate: float) -> float:
    """The law of contact `i` without its bounds."""
    if p.contacts[i, 2] == 1.0:
        return float(p.contacts[i, 0] * depth + p.contacts[i, 1] * rate)
    return float(p.contacts[i, 0] * max(depth, 0.0) ** p.contacts[i, 2] + p.contacts[i, 1] * rate)


@compiled
def _margin(p: Numbers, i: int, depth: float, rate: float) -> float:
    """Above zero where contact `i` is closed: there is overlap, and it presses."""
    return float(min(depth, _press(p, i, depth, rate) / p.contacts[i, 0]))


@compiled
def margins(p: Numbers, y: Array, gap: Array) -> None:
    """The margin of every contact."""
    R = rotation(y, SLIDER_TURN)
    for i in range(GUIDE_POINTS):
        depth, rate, _, _ = _at_point(p, y, i, R)
        gap[i] = _margin(p, i, depth, rate)
    depth, rate, _, _ = _in_socket(p, y)
    gap[SOCKET] = _margin(p, SOCKET, depth, rate)


@compiled
def _rubbing(p: Numbers, speed: float) -> float:
    """Friction over normal force at a sliding `speed` in m/s."""
    share = min(max((speed - _RAMP[0]) / (_RAMP[1] - _RAMP[0]), 0.0), 1.0)
    if p.friction[1] > 0.0:
        share *= 1 + p.friction[1] * exp(-speed / p.friction[2])
    return float(p.friction[0] * share)


@compiled
def _guide(p: Numbers, y: Array, R: Matrix, closed: Array, force: Array) -> tuple[Vector, Vector]:
    """Force on the slider and its moment about the centre, world axes; normal forces to `force`."""
    push = twist = (0.0, 0.0, 0.0)
    for i in range(GUIDE_POINTS):
        force[i] = 0.0
        if closed[i] > 0.0:
            depth, rate, arm, slip = _at_point(p, y, i, R)
            F = _press(p, i, depth, rate)
            force[i] = F
            normal = F * (1.0 - 2.0 * (i % 2))
            if i % 4 < 2:
                speed = sqrt(slip[0] * slip[0] + slip[2] * slip[2])
                drag = F * _rubbing(p, speed) / max(speed, 1e-12)
                total = (-drag * slip[0], normal, -drag * slip[2])
            else:
                speed = sqrt(slip[0] * slip[0] + slip[1] * slip[1])
                drag = F * _rubbing(p, speed) / max(speed, 1e-12)
                total = (-drag * slip[0], -drag * slip[1], normal)
            push = plus(push, total)
            twist = plus(twist, cross(arm, total))
    return push, twist


@compiled
def _socket(p: Numbers, y: Array, R: Matrix, closed: Array, force: Array) -> tuple[Vector, Vector]:
    """Force on the ball and the moment of its rubbing about the ball's centre, world axes."""
    depth, rate, out, slip = _in_socket(p, y)
    push, twist = times(-p.passive[1], slip), (0.0, 0.0, 0.0)
    force[SOCKET] = 0.0
    if closed[SOCKET] > 0.0:
        F = _press(p, SOCKET, depth, rate)
        force[SOCKET] = F
        push = plus(push, times(-F, out))
        if p.passive[0] > 0.0:
            # the socket turns with the crank, whose axis stands across `toward` and z
            speed = crank_speed(p, y[rest_at(p) + ANGLE])
            turning = to_world(R, three(y, speeds_at(p) + ROD_TURNING))
            turning = minus(turning, (speed * p.toward[1], -speed * p.toward[0], 0.0))
            arm = times(_BALL_RADIUS, out)
            surface = plus(slip, cross(turning, arm))
            surface = minus(surface, times(dot(surface, out), out))
            fast = sqrt(dot(surface, surface))
            share = min(max((fast - _RAMP[0]) / (_RAMP[1] - _RAMP[0]), 0.0), 1.0)
            rub = times(-p.passive[0] * share * F / max(fast, 1e-12), surface)
            push = plus(push, rub)
            twist = cross(arm, rub)
    return push, twist


@compiled
def _rod_equations(
    p: Numbers, y: Array, F: Vector, moment: Vector, arm: Vector, M: Array, side: Array, dy: Array
) -> None:
    """M (6, 6) and `side` of the rod's middle and turning with bending worked in; bending rates to `dy`.

    `F` at `arm` and `moment` in the rod's axes, N and N m.
    """
    v, m = speeds_at(p), len(p.omega) // 2
    spin = three(y, v + ROD_TURNING)
    square = dot(spin, spin)
    cu = cw = vu = vw = su = sw = uu = ww = uw = growth = across_u = across_w = 0.0
    for k in range(m):
        u, w, u_rate, w_rate = y[BEND + k], y[BEND + m + k], y[v + 12 + k], y[v + 12 + m + k]
        cu, cw = cu + p.sway[k] * u, cw + p.sway[k] * w
        vu, vw = vu + p.sway[k] * u_rate, vw + p.sway[k] * w_rate
        su, sw = su + p.swing[k] * u, sw + p.swing[k] * w
        uu, ww, uw = uu + u * u, ww + w * w, uw + u * w
        growth += u * u_rate + w * w_rate
        along = p.swing[k] * spin[0] + u * spin[1] + w * spin[2]
        across_u, across_w = across_u + u_rate * along, across_w + w_rate * along
        dy[v + 12 + k] = (
            -p.omega[k] ** 2 * u - p.loss[k] * u_rate + p.tip[k] * F[1]
            - spin[1] * along + square * u + 2 * spin[0] * w_rate
        )  # fmt: skip
        dy[v + 12 + m + k] = (
            -p.omega[m + k] ** 2 * w - p.loss[m + k] * w_rate + p.tip[m + k] * F[2]
            - spin[2] * along + square * w - 2 * spin[0] * u_rate
        )  # fmt: skip
    C, C_rate = (0.0, cu, cw), (0.0, vu, vw)
    Ix, Iy, Iz = p.rod_inertia[0] + uu + ww, p.rod_inertia[1] + ww, p.rod_inertia[2] + uu
    H = (Ix * spin[0] - su * spin[1] - sw * spin[2], -su * spin[0] + Iy * spin[1] - uw * spin[2],
         -sw * spin[0] - uw * spin[1] + Iz * spin[2])  # fmt: skip
    force = minus(F, plus(cross(spin, cross(spin, C)), times(2.0, cross(spin, C_rate))))
    turn = minus(plus(moment, cross(arm, F)), cross(spin, H))
    turn = minus(turn, times(2.0, minus(times(growth, spin), (0.0, across_u, across_w))))
    for i in range(6):
        for j in range(6):
            M[i, j] = 0.0
    for i in range(3):
        M[i, i] = p.rod_mass
        side[i], side[3 + i] = force[i], turn[i]
    M[3, 1], M[3, 2], M[4, 0], M[5, 0] = -cw, cu, cw, -cu
    M[3, 3], M[4, 4], M[5, 5] = Ix, Iy, Iz
    M[4, 3], M[5, 3], M[5, 4] = -su, -sw, -uw
    for k in range(m):
        u, w, a, b = y[BEND + k], y[BEND + m + k], p.sway[k], p.swing[k]
        f, g = dy[v + 12 + k], dy[v + 12 + m + k]
        # rows of the bending equations in the middle's acceleration and the turning's
        M[1, 1] -= a * a
        M[2, 2] -= a * a
        M[3, 1] += a * w
        M[5, 1] -= a * b
        M[3, 2] -= a * u
        M[4, 2] += a * b
        M[3, 3] -= w * w + u * u
        M[5, 3] += w * b
        M[4, 3] += u * b
        M[5, 5] -= b * b
        M[4, 4] -= b * b
        side[1] -= a * f
        side[2] -= a * g
        side[3] += w * f - u * g
        side[5] -= b * f
        side[4] += b * g


@compiled
def rates(p: Numbers, y: Array, closed: Array, dy: Array, s: Scratch) -> None:
    """dy/dt with the contacts in `closed` (> 0), and their normal forces to the scratch."""
    v = speeds_at(p)
    S, Q = rotation(y, SLIDER_TURN), rotation(y, ROD_TURN)
    push, twist = _guide(p, y, S, closed, s.force)
    ball, ball_twist = _socket(p, y, Q, closed, s.force)
    _move_rest(p, y, push, ball, dy)
    force = plus(push, (-p.passive[2] * y[v] - p.passive[3] * (y[0] - p.passive[4]), 0.0, 0.0))
    arm, _, _ = _ball(p, y)
    _rod_equations(p, y, to_body(Q, ball), to_body(Q, ball_twist), arm, s.rod, s.sides[4], dy)
    omega, spin = three(y, v + TURNING), three(y, v + ROD_TURNING)
    inertia = p.slider_inertia
    H = (inertia[0] * omega[0], inertia[1] * omega[1], inertia[2] * omega[2])
    moment = minus(to_body(S, twist), cross(omega, H))
    free = to_body(Q, times(1 / p.slider_mass, force))
    turned = (moment[0] / inertia[0], moment[1] / inertia[1], moment[2] / inertia[2])
    _set_joint(p, y, S, Q, free, turned, s)
    W = s.joint
    for k in range(6):
        total = s.sides[4, k]
        for j in range(4):
            total += W[j, 4] * s.sides[j, k]
        s.sides[4, k] = total
    for i in range(5, -1, -1):
        total = s.sides[4, i]
        for k in range(i + 1, 6):
            total -= s.rod[k, i] * s.sides[4, k]
        s.sides[4, i] = total / s.rod[i, i]
    held = to_world(Q, (W[0, 4], W[1, 4], W[2, 4]))
    a = to_world(Q, (s.sides[4, 0], s.sides[4, 1], s.sides[4, 2]))
    for i in range(3):
        dy[v + i] = (force[i] + held[i]) / p.slider_mass + p.gravity[i]
        turning = turned[i]
        for j in range(4):
            turning += s.rows[j, i] * W[j, 4] / inertia[i]
        dy[v + TURNING + i] = turning
        dy[v + ROD_VELOCITY + i] = a[i] + p.gravity[i]
        dy[v + ROD_TURNING + i] = s.sides[4, 3 + i]
        dy[SLIDER + i], dy[ROD + i] = y[v + i], y[v + ROD_VELOCITY + i]
    _turn(y, SLIDER_TURN, omega, dy)
    _turn(y, ROD_TURN, spin, dy)
    _bend(p, y, s.sides[4], dy)


@compiled
def _bend(p: Numbers, y: Array, x: Array, dy: Array) -> None:
    """What `_rod_equations` left out of the bending: accelerations of the rod, `x` (6,)."""
    v, m = speeds_at(p), len(p.omega) // 2
    for k in range(m):
        u, w = y[BEND + k], y[BEND + m + k]
        dy[BEND + k], dy[BEND + m + k] = y[v + 12 + k], y[v + 12 + m + k]
        dy[v + 12 + k] -= p.sway[k] * x[1] + p.swing[k] * x[5] - w * x[3]
        dy[v + 12 + m + k] -= p.sway[k] * x[2] - p.swing[k] * x[4] + u * x[3]


@compiled
def _turn(y: Array, at: int, omega: Vector, dy: Array) -> None:
    """The quaternion's rate at `omega` in the body's axes."""
    a, b, c, d = y[at], y[at + 1], y[at + 2], y[at + 3]
    dy[at] = 0.5 * (-b * omega[0] - c * omega[1] - d * omega[2])
    dy[at + 1] = 0.5 * (a * omega[0] + c * omega[2] - d * omega[1])
    dy[at + 2] = 0.5 * (a * omega[1] + d * omega[0] - b * omega[2])
    dy[at + 3] = 0.5 * (a * omega[2] + b * omega[1] - c * omega[0])


@compiled
def _move_rest(p: Numbers, y: Array, push: Vector, ball: Vector, dy: Array) -> None:
    """Crank, guide on its springs under the reaction to `push`, and what the motor does."""
    rest = rest_at(p)
    angle = y[rest + ANGLE]
    dy[rest + ANGLE] = crank_speed(p, angle)
    for axis in range(2):
        at, rate = rest + BASE + axis, rest + BASE_RATE + axis
        dy[at] = dy[rate] = 0.0
        if p.base[0] > 0.0:
            dy[at] = y[rate]
            dy[rate] = -(push[1 + axis] + p.base[1] * y[at] + p.base[2] * y[rate]) / p.base[0]
    _, moving = _pin(p, angle)
    dy[rest + WORK] = dot(ball, moving)


@compiled
def _set_joint(p: Numbers, y: Array, S: Matrix, Q: Matrix, free: Vector, turned: Vector, s: Scratch) -> None:
    """The universal joint's equations: its forces on the slider (rod's axes) and its torque.

    `free` and `turned`: the slider's accelerations without the joint, in the rod's and in its own axes.
    """
    v, h = speeds_at(p), p.half_length
    omega, spin = three(y, v + TURNING), three(y, v + ROD_TURNING)
    pin = (p.pin[0], p.pin[1], p.pin[2])
    yoke, cross_pin = (S[0][1], S[1][1], S[2][1]), (Q[0][2], Q[1][2], Q[2][2])
    normal = cross(yoke, cross_pin)
    to_slider, to_rod = to_body(S, normal), to_body(Q, normal)
    W, rows, sides = s.joint, s.rows, s.sides
    # how the slider's turning moves the pin and the angle between the yokes
    for j in range(3):
        unit = (Q[0][j], Q[1][j], Q[2][j])
        lever = cross(pin, to_body(S, unit))
        rows[j, 0], rows[j, 1], rows[j, 2] = lever
        for k in range(6):
            sides[j, k] = 0.0
        sides[j, j] = -1.0
    sides[1, 5], sides[2, 4] = -h, h
    for k in range(3):
        rows[3, k] = to_slider[k]
        sides[3, k], sides[3, 3 + k] = 0.0, -to_rod[k]
    off = to_body(Q, minus(plus(three(y, SLIDER), to_world(S, pin)), three(y, ROD)))
    off = minus(off, (h, 0.0, 0.0))
    drift = minus(plus(three(y, v), to_world(S, cross(omega, pin))), three(y, v + ROD_VELOCITY))
    drift = minus(to_body(Q, drift), cross(spin, (h, 0.0, 0.0)))
    bent = minus(
        to_body(Q, to_world(S, cross(omega, cross(omega, pin)))), cross(spin, cross(spin, (h, 0.0, 0.0)))
    )
    slider_turns, rod_turns = to_world(S, omega), to_world(Q, spin)
    moving = plus(cross(cross(slider_turns, yoke), cross_pin), cross(yoke, cross(rod_turns, cross_pin)))
    relative = minus(slider_turns, rod_turns)
    skewed = dot(relative, moving) + 2 * _PULL * dot(relative, normal)
    skewed += _PULL * _PULL * dot(yoke, cross_pin)
    drift = plus(times(2 * _PULL, drift), times(_PULL * _PULL, off))
    wanted = plus(plus(free, bent), drift)
    solve_lower(s.rod, 5, sides)
    _set_forces(p, turned, (wanted[0], wanted[1], wanted[2], skewed), s)
    solve_joint(W)


@compiled
def _set_forces(p: Numbers, turned: Vector, wanted: tuple[float, float, float, float], s: Scratch) -> None:
    """The joint's four equations from the rows of both bodies; `wanted`: what its forces have to undo."""
    W, rows, sides = s.joint, s.rows, s.sides
    for i in range(4):
        for j in range(4):
            W[i, j] = 0.0
            for k in range(6):
                W[i, j] += sides[i, k] * sides[j, k]
            for k in range(3):
                W[i, j] += rows[i, k] * rows[j, k] / p.slider_inertia[k]
        W[i, 4] = -wanted[i]
        for k in range(6):
            W[i, 4] -= sides[i, k] * sides[4, k]
        for k in range(3):
            W[i, 4] -= rows[i, k] * turned[k]
    for i in range(3):
        W[i, i] += 1 / p.slider_mass


@compiled
def _step(p: Numbers, y: Array, closed: Array, h: float, after: Array, s: Scratch) -> None:
    """One step of Runge and Kutta of `h` s from `y` to `after`, contacts as they are."""
    n = len(y)
    rates(p, y, closed, s.slopes[0], s)
    for stage in range(1, 4):
        part = h if stage == 3 else 0.5 * h
        for k in range(n):
            s.trial[k] = y[k] + part * s.slopes[stage - 1, k]
        rates(p, s.trial, closed, s.slopes[stage], s)
    for k in range(n):
        sum_of = s.slopes[0, k] + 2 * (s.slopes[1, k] + s.slopes[2, k]) + s.slopes[3, k]
        after[k] = y[k] + h / 6 * sum_of
    for at in (SLIDER_TURN, ROD_TURN):
        size = 0.0
        for k in range(at, at + 4):
            size += after[k] * after[k]
        for k in range(at, at + 4):
            after[k] /= sqrt(size)


@compiled
def _earliest(closed: Array, before: Array, after: Array) -> tuple[int, float]:
    """The contact that switches first between two margins, and at what share of the step; -1: none."""
    first, share = -1, 2.0
    for i in range(CONTACTS):
        if (after[i] > 0.0) != (closed[i] > 0.0):
            part = abs(before[i]) / (abs(before[i]) + abs(after[i]) + 1e-30)
            if part < share:
                first, share = i, part
    return first, share


@compiled
def _advance(
    p: Numbers, y: Array, closed: Array, time: float, h: float, s: Scratch, onsets: Array, found: int
) -> int:
    """Go on by `h` s, cut where contacts switch; onsets (time, contact, approach) are noted."""
    left = h
    margins(p, y, s.gap)
    for cut in range(_CUTS):
        _step(p, y, closed, left, s.after, s)
        margins(p, s.after, s.gap_after)
        which, share = _earliest(closed, s.gap, s.gap_after)
        if which < 0 or cut == _CUTS - 1:
            break
        low, high = 0.0, left
        low_gap, high_gap = s.gap[which], s.gap_after[which]
        part = left * share
        for _ in range(_SECTIONS):
            _step(p, y, closed, part, s.after, s)
            margins(p, s.after, s.gap_after)
            now = s.gap_after[which]
            if abs(now) < _NEAR:
                break
            if (now > 0.0) == (closed[which] > 0.0):
                low, low_gap, high_gap = part, now, 0.5 * high_gap
            else:
                high, high_gap, low_gap = part, now, 0.5 * low_gap
            part = low + (high - low) * min(max(abs(low_gap) / (abs(low_gap) + abs(high_gap)), 0.02), 0.98)
        y[:] = s.after
        s.gap[:] = s.gap_after
        left -= part
        closed[which] = -closed[which]
        if closed[which] > 0.0 and found < len(onsets):
            onsets[found, 0], onsets[found, 1] = time + h - left, which
            onsets[found, 2] = _approach(p, y, which)
            found += 1
    y[:] = s.after
    for i in range(CONTACTS):
        closed[i] = 1.0 if s.gap_after[i] > 0.0 else -1.0
    return found


@compiled
def _approach(p: Numbers, y: Array, which: int) -> float:
    if which == SOCKET:
        return _in_socket(p, y)[1]
    return _at_point(p, y, which, rotation(y, SLIDER_TURN))[1]


@compiled
def run(
    p: Numbers, y: Array, step: float, each: int, out: Array, onsets: Array, first: Array, s: Scratch
) -> int:
    """Fill `out` (12, samples), one every `each` steps; returns how many onsets were noted.

    Rows: forces of the points and the socket in N, crank angle in rad, the work so far in J, the slider's
    speed along the guide in m/s. `first` (9,):
    the largest force of each contact's first touch.
    """
    closed, touched = np.full(CONTACTS, -1.0), np.zeros(CONTACTS)
    margins(p, y, s.gap)
    for i in range(CONTACTS):
        closed[i] = 1.0 if s.gap[i] > 0.0 else -1.0
    found, rest = 0, rest_at(p)
    for sample in range(out.shape[1]):
        for k in range(each):
            found = _advance(p, y, closed, (sample * each + k) * step, step, s, onsets, found)
            for i in range(CONTACTS):
                pressed = s.force[i] if closed[i] > 0.0 else 0.0
                if pressed > 0.0 and touched[i] < 2.0:
                    touched[i] = 1.0
                    first[i] = max(first[i], pressed)
                elif touched[i] == 1.0:
                    touched[i] = 2.0
        margins(p, y, s.gap)
        rates(p, y, closed, s.slopes[0], s)
        for i in range(CONTACTS):
            out[i, sample] = max(s.force[i], 0.0)
        out[CONTACTS, sample], out[CONTACTS + 1, sample] = y[rest + ANGLE], y[rest + WORK]
        out[CONTACTS + 2, sample] = y[speeds_at(p)]
    return found


def scratch(size: int) -> Scratch:
    """Room for a state of `size` entries."""
    shapes: tuple[Any, ...] = (
        (4, size), size, size, (6, 6), (5, 6), (4, 5), (4, 3), CONTACTS, CONTACTS, CONTACTS,
    )  # fmt: skip
    return Scratch(*(np.zeros(shape) for shape in shapes))
