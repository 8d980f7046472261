"""Planar revolute joint with clearance: a journal inside a bearing (seed 001 section 2, eq. 1-8)."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from sim_twin.compiled import inlined
from sim_twin.contact import ContactLaw, Friction, contact_forces, friction_share


class RevoluteClearance(NamedTuple):
    """Radial `clearance` and `journal_radius` in m, and what acts at the contact."""

    clearance: float
    journal_radius: float
    law: ContactLaw
    friction: Friction


class RevoluteForce(NamedTuple):
    """What the journal does to the bearing: force `x`, `y` at the contact, its `normal` part, all N.

    Moments in N m about the centre of each: `on_bearing` and `on_journal`. `lost` is the power in W that
    hysteresis, damping and friction take.
    """

    x: float
    y: float
    normal: float
    on_bearing: float
    on_journal: float
    lost: float


_CENTRED = 1e-15
"""m; a journal nearer to the centre than that is in it."""


@inlined
def revolute_depth(clearance: float, ex: float, ey: float, vx: float, vy: float) -> tuple[float, float]:
    """Penetration in m and its rate in m/s, from where the journal's centre is in the bearing (eq. 1-2)."""
    e = sqrt(ex * ex + ey * ey)
    return e - clearance, (ex * vx + ey * vy) / max(e, _CENTRED)


@inlined
def revolute_force(
    joint: RevoluteClearance, ex: float, ey: float, vx: float, vy: float, spin_j: float, spin_b: float,
    v0: float,
) -> RevoluteForce:  # fmt: skip
    """Force of a contact that approached at `v0` m/s (eq. 7-13).

    `ex`, `ey` (m) and `vx`, `vy` (m/s): journal's centre less bearing's; `spin_j`, `spin_b` in rad/s. One
    point on the bearing's surface is where both forces act, so that they do no work as a pair.
    """
    e = sqrt(ex * ex + ey * ey)
    d = e - joint.clearance
    inverse = 1.0 / max(e, _CENTRED)
    nx, ny = ex * inverse, ey * inverse
    rate = nx * vx + ny * vy
    bearing_arm = joint.journal_radius + joint.clearance
    journal_arm = joint.journal_radius - d
    v = nx * vy - ny * vx + spin_j * journal_arm - spin_b * bearing_arm
    normal, elastic = contact_forces(joint.law, d, rate, v0)
    tangential = -friction_share(joint.friction, v) * normal
    lost = (normal - elastic) * rate + tangential * v
    return RevoluteForce(
        normal * nx - tangential * ny,
        normal * ny + tangential * nx,
        normal,
        bearing_arm * tangential,
        -journal_arm * tangential,
        lost,
    )
