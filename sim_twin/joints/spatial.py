"""Spatial joints with clearance: a ball in a socket, and a shell on a square guide.

The SCC and the SPCC of Deck and Dubowsky (seed 000, sections 2 and 4C, figures 3a and 3b). The ball touches
at one point anywhere on it, the shell at eight fixed points: 1 to 4 lie at one end of it on the faces +y, -y,
+z, -z, points 5 to 8 at the other end. They stand off the middle of the faces, all turned the same way round
the guide at one end and the other way at the other, so that they also hold the shell against rolling and up
to six touch at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import inlined
from sim_twin.contact import ContactLaw, Friction, friction_share
from sim_twin.joints.vectors import Vector, dot, norm, scaled, subtracted
from sim_twin.ranges import require

_CENTRED, _STILL = 1e-15, 1e-300
Array = NDArray[np.float64]
POINTS = 8


@dataclass(frozen=True, slots=True)
class SphericalJoint:
    """`clearance` in m is socket radius minus ball radius; `law` of the contact."""

    clearance: float
    law: ContactLaw

    def __post_init__(self) -> None:
        require("spherical joint", "clearance", self.clearance, 0.0, unit="m")


class Touch(NamedTuple):
    """A possible contact: `depth` in m (positive: overlap), its `rate` in m/s, `normal` along which the
    first body is pushed."""

    depth: float
    rate: float
    normal: Vector


@inlined
def ball_in_socket(ball: Vector, ball_velocity: Vector, centre: Vector, velocity: Vector, c: float) -> Touch:
    """The ball's contact with its socket around `centre` (m, m/s); the normal points away from the wall."""
    offset = subtracted(ball, centre)
    e = norm(offset)
    out = scaled(1.0 / max(e, _CENTRED), offset)
    rate = dot(out, subtracted(ball_velocity, velocity))
    return Touch(e - c, rate, scaled(-1.0, out))


@dataclass(frozen=True, slots=True)
class PrismaticJoint:
    """A guide of `half_side` in m and a shell with `clearance` in m at every face when centred.

    `span` in m is how far the points lie before and behind the shell's centre, `offset` in m how far off the
    middle of a face.
    """

    half_side: float
    clearance: float
    span: float
    offset: float
    law: ContactLaw
    friction: Friction

    def __post_init__(self) -> None:
        for name in ("half_side", "span"):
            require("prismatic joint", name, getattr(self, name), 0.0, unit="m", above=True)
        require("prismatic joint", "clearance", self.clearance, 0.0, unit="m")
        require("prismatic joint", "offset", self.offset, 0.0, self.half_side, unit="m")

    def points(self) -> Array:
        """Contact points from the shell's centre in its own frame, m, shape (8, 3); x along the guide."""
        w, e = self.half_side + self.clearance, self.offset
        faces = np.array([[0.0, w, e], [0.0, -w, -e], [0.0, 0.0, w], [0.0, 0.0, -w]])
        mirrored = faces * [1.0, 1.0, -1.0]
        mirrored[2:] = faces[2:]
        along = np.array([self.span, 0.0, 0.0])
        return np.vstack([faces - along, mirrored + along])


@inlined
def face_axis(point: int) -> int:
    """The axis, 1 (y) or 2 (z), that the face of `point` (0 to 7) is normal to."""
    return 1 + (point % 4) // 2


@inlined
def face_side(point: int) -> float:
    """+1.0 where the shell's `point` (0 to 7) lies beyond the guide's positive face, else -1.0."""
    return 1.0 - 2.0 * (point % 2)


@inlined
def friction_force(friction: Friction, normal_force: float, axis: int, slip: Vector) -> Vector:
    """Friction on a point that slides with velocity `slip` (m/s) over a face normal to `axis` (1 or 2), N."""
    u, v = slip[0], slip[3 - axis]
    speed = sqrt(u * u + v * v)
    each = friction_share(friction, speed) * normal_force / max(speed, _STILL)
    if axis == 1:
        return each * u, 0.0, each * v
    return each * u, each * v, 0.0
