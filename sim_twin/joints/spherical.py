"""Spherical joint with clearance: a ball in a socket, touching at one point anywhere on it.

The SCC of Deck and Dubowsky (seed 000, section 2 and figure 3a).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from sim_twin.compiled import inlined
from sim_twin.contact.laws import ContactLaw
from sim_twin.joints.vectors import Vector, dot, norm, scaled, subtracted
from sim_twin.ranges import require

_CENTRED = 1e-15


@dataclass(frozen=True, slots=True)
class SphericalJoint:
    """`clearance` in m is socket radius minus ball radius; `law` of the contact."""

    clearance: float
    law: ContactLaw

    def __post_init__(self) -> None:
        require("spherical joint", "clearance", self.clearance, 0.0, unit="m", above=True)


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
