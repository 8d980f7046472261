"""Spatial revolute joint with clearance: a journal in a bearing of finite length.

The SRCC that Deck and Dubowsky name (seed 000, section 2). The journal touches at one end of the bearing, at
both on the same side or, tilted, on opposite sides, and its shoulders run against the bearing's faces. All in
the bearing's frame, whose x is the bearing's axis; the tilt is small (its square is left out of the depth, as
the journal's section there is an ellipse).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import inlined
from sim_twin.contact.laws import ContactLaw, Friction, friction_share, normal_force
from sim_twin.joints.spherical import Touch
from sim_twin.joints.vectors import Vector, added, cross, dot, norm, scaled, subtracted
from sim_twin.ranges import require

Array = NDArray[np.float64]
CONTACTS = 4
"""Bearing's end at -x, its end at +x, shoulder at +x (stops motion along +x), shoulder at -x."""
_CENTRED = 1e-15


@dataclass(frozen=True, slots=True)
class RevoluteJoint:
    """Radial `clearance`, bearing `length`, `end_play` (half the axial motion) and journal `radius`, in m.

    `law` holds for each contact on its own, `friction` at all of them.
    """

    clearance: float
    length: float
    end_play: float
    radius: float
    law: ContactLaw
    friction: Friction

    def __post_init__(self) -> None:
        for name in ("clearance", "length", "end_play", "radius"):
            require("revolute joint", name, getattr(self, name), 0.0, unit="m", above=True)

    def numbers(self) -> RevoluteNumbers:
        """As kernels take it."""
        half = self.length / 2
        return RevoluteNumbers(self.clearance, half, self.end_play, self.radius, self.law, self.friction)


class RevoluteNumbers(NamedTuple):
    """RevoluteJoint for kernels; `half_length` of the bearing."""

    clearance: float
    half_length: float
    end_play: float
    radius: float
    law: ContactLaw
    friction: Friction


class Journal(NamedTuple):
    """Its centre `place` (m), unit vector `axis`, `velocity` (m/s), angular velocity `omega` (rad/s)."""

    place: Vector
    axis: Vector
    velocity: Vector
    omega: Vector


@inlined
def journal_touch(p: RevoluteNumbers, journal: Journal, contact: int) -> tuple[Touch, Vector]:
    """One of the four possible contacts, and where it acts from the journal's centre, m."""
    if contact >= 2:
        return _shoulder(p, journal, 1.0 if contact == 2 else -1.0)
    return _end(p, journal, -p.half_length if contact == 0 else p.half_length)


@inlined
def journal_load(p: RevoluteNumbers, journal: Journal, v0: Array) -> tuple[Vector, Vector]:
    """Force (N) and moment about its centre (N m) that the bearing exerts on the journal.

    `v0` (4,) in m/s: approach speeds of the contacts that touch, 0 for the others.
    """
    force = moment = (0.0, 0.0, 0.0)
    for contact in range(CONTACTS):
        touch, arm = journal_touch(p, journal, contact)
        F = normal_force(p.law, touch.depth, touch.rate, v0[contact]) if v0[contact] > 0.0 else 0.0
        if F > 0.0:
            push = added(scaled(F, touch.normal), _friction(p, journal, touch, arm, F))
            force, moment = added(force, push), added(moment, cross(arm, push))
    return force, moment


@inlined
def _end(p: RevoluteNumbers, journal: Journal, x: float) -> tuple[Touch, Vector]:
    along = (x - journal.place[0]) / journal.axis[0]
    arm = scaled(along, journal.axis)
    y, z = journal.place[1] + arm[1], journal.place[2] + arm[2]
    e = norm((0.0, y, z))
    out = scaled(1.0 / max(e, _CENTRED), (0.0, y, z))
    # The journal also slides along its axis through the plane of the bearing's end.
    moving = added(journal.velocity, cross(journal.omega, arm))
    moving = subtracted(moving, scaled(moving[0] / journal.axis[0], journal.axis))
    touch = Touch(e - p.clearance, dot(out, moving), scaled(-1.0, out))
    return touch, added(arm, scaled(p.radius, out))


@inlined
def _shoulder(p: RevoluteNumbers, journal: Journal, side: float) -> tuple[Touch, Vector]:
    depth, rate = side * journal.place[0] - p.end_play, side * journal.velocity[0]
    return Touch(depth, rate, (-side, 0.0, 0.0)), scaled(side * p.half_length, journal.axis)


@inlined
def _friction(p: RevoluteNumbers, journal: Journal, touch: Touch, arm: Vector, F: float) -> Vector:
    slip = added(journal.velocity, cross(journal.omega, arm))
    slip = subtracted(slip, scaled(dot(slip, touch.normal), touch.normal))
    speed = norm(slip)
    share = friction_share(p.friction, speed)
    return scaled(share * F / max(speed, _CENTRED), slip)
