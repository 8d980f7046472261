"""Laws of contact for kernels: a normal force over penetration and its rate, and Coulomb friction.

All laws are one formula with different numbers,

    F = K d^n (1 + chi d'/v0) + c d',   never negative (no pull),

so that a joint takes any of them. d is the penetration in m, d' its rate, v0 the approach speed latched at
the onset of the contact."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from sim_twin.compiled import inlined


class ContactLaw(NamedTuple):
    """K = `stiffness` N/m^n, n = `exponent`, chi = `hysteresis`, c = `damping` N s/m."""

    stiffness: float
    exponent: float
    hysteresis: float
    damping: float


class Friction(NamedTuple):
    """Coulomb friction `coefficient` that sets in between the sliding speeds `v_0` and `v_1` in m/s."""

    coefficient: float
    v_0: float
    v_1: float


def linear(stiffness: float, damping: float) -> ContactLaw:
    """Spring (N/m) and damper (N s/m); the contact ends where their sum reaches zero."""
    return ContactLaw(stiffness, 1.0, 0.0, damping)


def hertz(stiffness: float, damping: float = 0.0) -> ContactLaw:
    """Hertz's K d^1.5 (N/m^1.5), with a damper (N s/m) if wanted."""
    return ContactLaw(stiffness, 1.5, 0.0, damping)


def lankarani_nikravesh(stiffness: float, restitution: float) -> ContactLaw:
    """Hertz with hysteresis 3 (1 - e^2) / 4 (seed 001 eq. 8 and 11; 10.1115/1.2912617)."""
    return ContactLaw(stiffness, 1.5, 0.75 * (1.0 - restitution**2), 0.0)


@inlined
def elastic_force(law: ContactLaw, d: float) -> float:
    """K d^n in N; zero without penetration."""
    if d <= 0.0:
        return 0.0
    if law.exponent == 1.5:
        return law.stiffness * d * sqrt(d)
    if law.exponent == 1.0:
        return law.stiffness * d
    return float(law.stiffness * d**law.exponent)


@inlined
def normal_force(law: ContactLaw, d: float, rate: float, v0: float) -> float:
    """Normal force in N at penetration `d` m, its `rate` m/s, after an approach at `v0` > 0 m/s."""
    if d <= 0.0:
        return 0.0
    return max(0.0, elastic_force(law, d) * (1.0 + (law.hysteresis / v0) * rate) + law.damping * rate)


@inlined
def friction_share(friction: Friction, v: float) -> float:
    """Friction force over normal force, against the sliding velocity `v` in m/s (seed 001 eq. 12-13)."""
    speed, share = abs(v), friction.coefficient
    if speed <= friction.v_0:
        return 0.0
    if speed < friction.v_1:
        share *= (speed - friction.v_0) / (friction.v_1 - friction.v_0)
    return -share if v > 0.0 else share
