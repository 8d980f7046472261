"""Planar translational joint with clearance: a rectangular slider in a guide along x, contact at its corners.

Geometry of 10.1007/s11044-009-9178-y (section 5): four corners, each against the wall on its side.
"""

from __future__ import annotations

from typing import NamedTuple

from sim_twin.compiled import inlined
from sim_twin.contact.laws import ContactLaw, Friction, elastic_force, friction_share, normal_force

CORNERS = 4


class TranslationalClearance(NamedTuple):
    """Half the slider's size and the `clearance` on each side in m, and what acts at a corner."""

    half_length: float
    half_width: float
    clearance: float
    law: ContactLaw
    friction: Friction


class CornerForce(NamedTuple):
    """What the guide does to the slider at a corner: `x`, `y` and the `normal` part in N.

    `moment` is about the slider's centre, in N m; `lost` the power in W that hysteresis and friction take.
    """

    x: float
    y: float
    normal: float
    moment: float
    lost: float


NO_FORCE = CornerForce(0.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def corner_arm(
    joint: TranslationalClearance, corner: int, sine: float, cosine: float
) -> tuple[float, float, float]:
    """From the slider's centre to a corner in m, and the wall's side: 1 above (corners 0, 1), -1 below."""
    side = 1.0 if corner < 2 else -1.0
    along = -joint.half_length if corner % 2 == 0 else joint.half_length
    across = side * joint.half_width
    return along * cosine - across * sine, along * sine + across * cosine, side


@inlined
def corner_depth(
    joint: TranslationalClearance, corner: int, y: float, vy: float, sine: float, cosine: float, spin: float
) -> tuple[float, float]:
    """Penetration of a corner in m and its rate in m/s, from the centre's height, its speed and the spin."""
    ax, ay, side = corner_arm(joint, corner, sine, cosine)
    return side * (y + ay) - joint.half_width - joint.clearance, side * (vy + spin * ax)


@inlined
def corner_force(
    joint: TranslationalClearance, corner: int, y: float, vx: float, vy: float, sine: float, cosine: float,
    spin: float, v0: float,
) -> CornerForce:  # fmt: skip
    """Force at a corner that approached at `v0` m/s; friction is that of the corner's own speed along x."""
    ax, ay, side = corner_arm(joint, corner, sine, cosine)
    d, rate = corner_depth(joint, corner, y, vy, sine, cosine, spin)
    if d <= 0.0:
        return NO_FORCE
    normal = normal_force(joint.law, d, rate, v0)
    slip = vx - spin * ay
    x, up = friction_share(joint.friction, slip) * normal, -side * normal
    lost = (normal - elastic_force(joint.law, d)) * rate - x * slip
    return CornerForce(x, up, normal, ax * up - ay * x, lost)
