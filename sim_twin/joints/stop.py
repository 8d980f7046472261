"""One-dimensional stop: a point that may move up to a wall."""

from __future__ import annotations

from sim_twin.compiled import inlined
from sim_twin.joints.spherical import Touch
from sim_twin.joints.vectors import Vector, dot, scaled, subtracted


@inlined
def stop(point: Vector, velocity: Vector, wall: Vector, wall_velocity: Vector, out: Vector) -> Touch:
    """Contact of a point with the wall through `wall` (m, m/s); the unit vector `out` points into it."""
    depth = dot(out, subtracted(point, wall))
    return Touch(depth, dot(out, subtracted(velocity, wall_velocity)), scaled(-1.0, out))
