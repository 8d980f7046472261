"""The rig in motion: from ideal joints at any angle of the crank, in fixed steps."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

from benchmarks.blind.finite_elements import Array
from benchmarks.blind.spatial import engine
from benchmarks.blind.spatial.engine import CONTACTS, GUIDE_POINTS, Numbers
from benchmarks.blind.spatial.rig import Spatial
from benchmarks.blind.spatial.rod import bending
from benchmarks.blind.spatial.vectors import rotation, to_body

_ONSETS_A_SECOND = 40_000


@dataclass(frozen=True, slots=True)
class Motion:
    """`forces` (9, n) of points and socket in N; the crank's `angle` in rad, the motor's `work` in J, (n,).

    `slider_speed` along the guide in m/s, (n,). `onsets` (m, 3): time in s, contact, approach in m/s. `first`
    (9,): the largest force of each contact's first touch, at the ends of steps. `end`: the last state.
    """

    forces: Array
    angle: Array
    work: Array
    slider_speed: Array
    onsets: Array
    first: Array
    end: Array


@dataclass(frozen=True, slots=True)
class Start:
    """Ideal joints: slider's place and speed along the guide, rod's middle, velocity, turning, quaternion.

    The turning is in the world's axes.
    """

    slider: float
    slider_speed: float
    rod: Array
    rod_velocity: Array
    turning: Array
    turn: Array


def moved(rig: Spatial, angle: float, step: float, count: int, each: int = 1) -> Motion:
    """From ideal joints at the crank's `angle` in rad: `count` samples, each after `each` steps (s).

    Raises ArithmeticError where the steps are so long that the motion runs away.
    """
    p = numbers(rig)
    y = state(rig, p, angle)
    out = np.zeros((engine.OUTPUTS, count))
    onsets = np.zeros((int(_ONSETS_A_SECOND * (step * each * count + 0.1)), 3))
    first = np.zeros(CONTACTS)
    found = engine.run(p, y, step, each, out, onsets, first, engine.scratch(len(y)))
    if not np.isfinite(y).all():
        raise ArithmeticError(f"the steps of {step:.3g} s are too long for {rig}")
    turned, work, speed = CONTACTS, CONTACTS + 1, CONTACTS + 2
    return Motion(out[:CONTACTS], out[turned], out[work], out[speed], onsets[:found], first, y)


def numbers(rig: Spatial) -> Numbers:
    """What the engine takes."""
    rod, modes, slider = rig.rod, bending(rig.rod), rig.slider
    omega = np.tile(modes.omega, 2) * rod.detuned
    across = rod.mass * (rod.length**2 / 12 + rod.diameter**2 / 16)
    base = np.zeros(3)
    if rig.base is not None:
        turns = 2 * pi * rig.base.frequency
        base = rig.base.mass * np.array([1.0, turns**2, 2 * rig.base.damping_ratio * turns])
    i, r = rig.incline, rig.roll
    return Numbers(
        omega=omega,
        loss=2 * np.array(rod.damping) * omega,
        tip=np.tile(modes.tip, 2),
        sway=np.tile(modes.sway, 2),
        swing=np.tile(modes.swing, 2),
        half_length=rod.length / 2,
        rod_mass=rod.mass,
        rod_inertia=np.array([rod.mass * rod.diameter**2 / 8, across, across]),
        slider_mass=slider.mass,
        slider_inertia=np.array(slider.inertia),
        pin=np.array(slider.pin),
        points=contact_points(rig),
        half_side=rig.half_side,
        clearance=rig.socket_clearance,
        contacts=np.array(
            [[c.stiffness, c.damping, c.exponent] for c in (*[rig.guide] * GUIDE_POINTS, rig.socket)]
        ),
        friction=np.array([rig.friction.coefficient, rig.friction.more, rig.friction.fading]),
        base=base,
        drive=np.array([rig.speed, rig.ripple.amplitude, rig.ripple.order, rig.ripple.phase]),
        passive=np.array([rig.socket_friction, rig.film, rig.drag, rig.spring, rod.length]),
        radius=rig.crank_radius,
        toward=_toward(rig),
        centre=np.array([0.0, slider.pin[1], slider.pin[2]]),
        gravity=rig.gravity * np.array([sin(i), -cos(i) * sin(r), -cos(i) * cos(r)]),
    )


def contact_points(rig: Spatial) -> Array:
    """From the slider's centre in m, shape (8, 3): +y, -y, +z, -z towards the crank, then the other end.

    Those on +-y stand beside the middle: at one end so that they hold the slider against rolling one way, at
    the other the other way. A worn point lies further from the guide.
    """
    away = rig.half_side + rig.guide_clearance
    points = np.zeros((GUIDE_POINTS, 3))
    for i in range(GUIDE_POINTS):
        end, side, axis = (-1, 1)[i // 4], (1, -1)[i % 2], 1 + i % 4 // 2
        points[i, 0] = end * rig.span
        points[i, axis] = side * (away + rig.worn[i])
        if axis == 1:
            points[i, 2] = -end * side * rig.offset
    return points


def started(rig: Spatial, angle: float) -> Start:
    """Where ideal joints have the parts, and how they move, with the crank at `angle` in rad."""
    ripple, length = rig.ripple, rig.rod.length
    speed = rig.speed * (1 + ripple.amplitude * sin(ripple.order * angle + ripple.phase))
    toward, up = _toward(rig), np.array([0.0, 0.0, 1.0])
    ball = rig.crank_radius * (cos(angle) * toward + sin(angle) * up)
    ball_velocity = rig.crank_radius * speed * (cos(angle) * up - sin(angle) * toward)
    along = np.sqrt(length**2 - ball[1] ** 2 - ball[2] ** 2)
    slider_speed = ball_velocity[0] - (ball[1] * ball_velocity[1] + ball[2] * ball_velocity[2]) / along
    pin = np.array([ball[0] + along, 0.0, 0.0])
    way = (pin - ball) / length
    way_rate = (np.array([slider_speed, 0.0, 0.0]) - ball_velocity) / length
    third = np.cross(way, [0.0, 1.0, 0.0])
    third /= np.linalg.norm(third)
    turning = np.cross(way, way_rate)
    # the cross pin stays across the slider's y: the rod spins about itself as that asks
    normal = np.cross([0.0, 1.0, 0.0], third)
    turning -= way * (turning @ normal) / (way @ normal)
    turn = _quaternion(np.column_stack([way, np.cross(third, way), third]))
    place = np.array([0.0, *rig.slider.pin[1:]]) + (ball + pin) / 2
    velocity = (ball_velocity + np.array([slider_speed, 0.0, 0.0])) / 2
    return Start(pin[0] - rig.slider.pin[0], slider_speed, place, velocity, turning, turn)


def state(rig: Spatial, p: Numbers, angle: float) -> Array:
    """The engine's state for that start, nothing bent."""
    start, v, rest = started(rig, angle), engine.speeds_at(p), engine.rest_at(p)
    y = np.zeros(rest + engine.REST)
    y[0], y[engine.SLIDER_TURN] = start.slider, 1.0
    y[engine.ROD : engine.ROD + 3], y[engine.ROD_TURN : engine.ROD_TURN + 4] = start.rod, start.turn
    y[v], y[v + engine.ROD_VELOCITY : v + engine.ROD_VELOCITY + 3] = start.slider_speed, start.rod_velocity
    turning = to_body(rotation(y, engine.ROD_TURN), tuple(start.turning))
    y[v + engine.ROD_TURNING : v + engine.ROD_TURNING + 3] = turning
    y[rest + engine.ANGLE] = angle
    return y


def _toward(rig: Spatial) -> Array:
    return np.array([sin(rig.axis_angle), -cos(rig.axis_angle), 0.0])


def _quaternion(R: Array) -> Array:
    """Of a rotation by less than half a turn."""
    a = np.sqrt(1 + np.trace(R)) / 2
    return np.array([a, *(np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4 * a))])
