"""Slider-crank with ideal pins whose slider has clearance in its guide: Flores, Leine and Glocker 2010.

10.1007/s11044-009-9178-y, section 5: a rectangular slider, contact at its four corners, each against the wall
on its side. No motor: it starts at speed and coasts. State: angles of crank, rod and slider (rad), their
rates, and the energy lost in contacts (J).
"""

from __future__ import annotations

from typing import NamedTuple

from sim_twin.compiled import generic
from sim_twin.contact import (
    ContactLaw,
    Friction,
    contact_forces,
    friction_share,
    lankarani_nikravesh,
)
from sim_twin.joints.vectors import sine_cosine
from sim_twin.mechanisms.integrator import integrate
from sim_twin.mechanisms.run import Real, Run, StepLimits

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


@generic
def corner_arm(
    joint: TranslationalClearance, corner: int, sine: float, cosine: float
) -> tuple[float, float, float]:
    """From the slider's centre to a corner in m, and the wall's side: 1 above (corners 0, 1), -1 below."""
    side = 1.0 if corner < 2 else -1.0
    along = -joint.half_length if corner % 2 == 0 else joint.half_length
    across = side * joint.half_width
    return along * cosine - across * sine, along * sine + across * cosine, side


@generic
def corner_depth(
    joint: TranslationalClearance, corner: int, y: float, vy: float, sine: float, cosine: float, spin: float
) -> tuple[float, float]:
    """Penetration of a corner in m and its rate in m/s, from the centre's height, its speed and the spin."""
    ax, ay, side = corner_arm(joint, corner, sine, cosine)
    return side * (y + ay) - joint.half_width - joint.clearance, side * (vy + spin * ax)


@generic
def corner_force(
    joint: TranslationalClearance, corner: int, y: float, vx: float, vy: float, sine: float, cosine: float,
    spin: float, v0: float,
) -> CornerForce:  # fmt: skip
    """Force at a corner that approached at `v0` m/s; friction is that of the corner's own speed along x."""
    ax, ay, side = corner_arm(joint, corner, sine, cosine)
    d, rate = corner_depth(joint, corner, y, vy, sine, cosine, spin)
    if d <= 0.0:
        return NO_FORCE
    normal, elastic = contact_forces(joint.law, d, rate, v0)
    slip = vx - spin * ay
    x, up = friction_share(joint.friction, slip) * normal, -side * normal
    lost = (normal - elastic) * rate - x * slip
    return CornerForce(x, up, normal, ax * up - ay * x, lost)


STATES = 7
LOST = 6
OUTPUTS = 6


class GuidedSliderCrank(NamedTuple):
    """Lengths m, masses kg, inertias kg m2 of crank, rod and slider; centres of mass at mid length."""

    l_1: float
    l_2: float
    m_1: float
    m_2: float
    m_3: float
    J_1: float
    J_2: float
    J_3: float
    gravity: float
    guide: TranslationalClearance


def flores_leine_glocker(stiffness: float = 1e8) -> GuidedSliderCrank:
    """The paper's example; its rigid contact becomes one of `stiffness` N/m^1.5 (assumed), e and mu stay."""
    guide = TranslationalClearance(
        0.05, 0.025, 0.001, lankarani_nikravesh(stiffness, 0.4), Friction(0.01, 1e-4, 1e-3)
    )
    return GuidedSliderCrank(0.153, 0.306, 0.038, 0.038, 0.076, 7.4e-5, 5.9e-4, 2.7e-6, 9.81, guide)


# Compiled anew in each session: a cache would know of changes in this file alone.
@generic
def rates(p: GuidedSliderCrank, t: float, y: Real, v0: Real, dy: Real, force: Real) -> None:
    """Lagrange's equations in the three absolute angles."""
    s1, c1 = sine_cosine(y[0])
    s2, c2 = sine_cosine(y[1])
    s3, c3 = sine_cosine(y[2])
    height = p.l_1 * s1 + p.l_2 * s2
    vx, vy = -p.l_1 * s1 * y[3] - p.l_2 * s2 * y[4], p.l_1 * c1 * y[3] + p.l_2 * c2 * y[4]
    fx, fy, moment, lost = 0.0, -p.m_3 * p.gravity, 0.0, 0.0
    for corner in range(CORNERS):
        force[corner] = 0.0
        if v0[corner] > 0.0:
            at = corner_force(p.guide, corner, height, vx, vy, s3, c3, y[5], v0[corner])
            fx, fy, moment, lost = fx + at.x, fy + at.y, moment + at.moment, lost + at.lost
            force[corner] = at.normal
    coupling = p.l_1 * p.l_2 * (0.5 * p.m_2 + p.m_3)
    m11 = p.J_1 + (0.25 * p.m_1 + p.m_2 + p.m_3) * p.l_1 * p.l_1
    m22 = p.J_2 + (0.25 * p.m_2 + p.m_3) * p.l_2 * p.l_2
    m12, swing = coupling * (c1 * c2 + s1 * s2), coupling * (s1 * c2 - c1 * s2)
    weight_1, weight_2 = (0.5 * p.m_1 + p.m_2) * p.gravity, 0.5 * p.m_2 * p.gravity
    q1 = p.l_1 * (c1 * (fy - weight_1) - s1 * fx) - swing * y[4] * y[4]
    q2 = p.l_2 * (c2 * (fy - weight_2) - s2 * fx) + swing * y[3] * y[3]
    inverse = 1.0 / (m11 * m22 - m12 * m12)
    dy[0], dy[1], dy[2] = y[3], y[4], y[5]
    dy[3], dy[4] = inverse * (m22 * q1 - m12 * q2), inverse * (m11 * q2 - m12 * q1)
    dy[5], dy[LOST] = moment / p.J_3, lost


@generic
def depths(p: GuidedSliderCrank, t: float, y: Real, d: Real, rate: Real) -> None:
    """Penetration of the four corners and its rate."""
    s1, c1 = sine_cosine(y[0])
    s2, c2 = sine_cosine(y[1])
    s3, c3 = sine_cosine(y[2])
    height, vy = p.l_1 * s1 + p.l_2 * s2, p.l_1 * c1 * y[3] + p.l_2 * c2 * y[4]
    for corner in range(CORNERS):
        d[corner], rate[corner] = corner_depth(p.guide, corner, height, vy, s3, c3, y[5])


@generic
def observe(p: GuidedSliderCrank, t: float, y: Real, v0: Real, out: Real, column: int) -> None:
    """The three angles (rad) and their rates (rad/s)."""
    for i in range(OUTPUTS):
        out[i, column] = y[i]


@generic
def run(
    p: GuidedSliderCrank, state: Run, limits: StepLimits, dt: float, out: Real, episodes: Real
) -> int:  # fmt: skip
    """`integrate` for this mechanism."""
    return integrate(rates, depths, observe, p, state, limits, dt, out, episodes)
