"""Where everything is, and how fast: compiled kinematics of the spatial slider-crank.

The slider turns by Gibbs' vector g, the rod against the slider by alpha about the slider's y and then by beta
about its own third axis. The rod lies along its -x, towards the crank.
"""

from __future__ import annotations

from typing import NamedTuple

from sim_twin.compiled import mechanical
from sim_twin.joints.vectors import (
    Rotation,
    Vector,
    added,
    cross,
    gibbs_rotation,
    inward,
    outward,
    product,
    sine_cosine,
    subtracted,
)
from sim_twin.rigs.spatial_slider_crank.constants import RIGID, Array, Constants


class Pose(NamedTuple):
    """World frame unless said: `pin` the universal joint, `slider` and `rod` the rotations.

    `joint` is the rod's rotation in the slider's frame, `axis` the slider's y in the rod's. `Omega` (rod's
    frame) and `omega` (slider's) are angular velocities in rad/s, `relative` their difference in the rod's
    frame. `tip` (rod's frame) lies from the pin to the ball.
    """

    pin: Vector
    velocity: Vector
    slider: Rotation
    joint: Rotation
    rod: Rotation
    axis: Vector
    Omega: Vector
    relative: Vector
    omega: Vector
    tip: Vector
    ball: Vector
    ball_velocity: Vector


@mechanical
def pose(p: Constants, y: Array) -> Pose:
    """Positions and velocities at state `y`."""
    m = p.modes
    n = RIGID + 2 * m
    slider = gibbs_rotation((y[3], y[4], y[5]))
    sa, ca = sine_cosine(y[6])
    sb, cb = sine_cosine(y[7])
    joint = ((ca * cb, -ca * sb, sa), (sb, cb, 0.0), (-sa * cb, sa * sb, ca))
    rod = product(slider, joint)
    axis = (sb, cb, 0.0)
    Omega = (y[n + 3], y[n + 4], y[n + 5])
    relative = (sb * y[n + 6], cb * y[n + 6], y[n + 7])
    omega = outward(joint, subtracted(Omega, relative))
    u = w = u_rate = w_rate = 0.0 * p.rod_length  # in as many lanes as that
    for k in range(m):
        u += p.tip[k] * y[RIGID + k]
        w += p.tip[k] * y[RIGID + m + k]
        u_rate += p.tip[k] * y[n + RIGID + k]
        w_rate += p.tip[k] * y[n + RIGID + m + k]
    tip, tip_rate = (-p.rod_length, u, w), (0.0, u_rate, w_rate)
    pin, velocity = (y[0], y[1], y[2]), (y[n], y[n + 1], y[n + 2])
    ball = added(pin, outward(rod, tip))
    ball_velocity = added(velocity, outward(rod, added(tip_rate, cross(Omega, tip))))
    return Pose(pin, velocity, slider, joint, rod, axis, Omega, relative, omega, tip, ball, ball_velocity)


@mechanical
def crank_pin(p: Constants, theta: float) -> Vector:
    """Centre of the socket at crank angle `theta`, m."""
    sine, cosine = sine_cosine(theta)
    along, up = p.radius * cosine, p.radius * sine
    return (
        p.centre[0] + along * p.toward[0],
        p.centre[1] + along * p.toward[1],
        p.centre[2] + along * p.toward[2] + up,
    )


@mechanical
def crank_pin_velocity(p: Constants, theta: float) -> Vector:
    """Its velocity, m/s."""
    speed = crank_speed(p, theta)
    sine, cosine = sine_cosine(theta)
    along, up = -p.radius * sine * speed, p.radius * cosine * speed
    return along * p.toward[0], along * p.toward[1], along * p.toward[2] + up


@mechanical
def crank_speed(p: Constants, theta: float) -> float:
    """omega = omega_0 (1 + amplitude sin(order theta + phase)), rad/s."""
    return float(p.drive[0] * (1.0 + p.drive[1] * sine_cosine(p.drive[2] * theta + p.drive[3])[0]))


@mechanical
def slider_point(pose: Pose, at: Vector) -> tuple[Vector, Vector]:
    """Place and velocity of a point of the slider that lies `at` from the pin in the slider's frame."""
    place = added(pose.pin, outward(pose.slider, at))
    return place, added(pose.velocity, outward(pose.slider, cross(pose.omega, at)))


@mechanical
def to_rod(pose: Pose, a: Vector) -> Vector:
    """From the world's frame to the rod's."""
    return inward(pose.rod, a)
