"""Laws of contact for kernels: a normal force over penetration and its rate, and Coulomb friction.

All laws are one formula with different numbers,

    F = K d^n (1 + chi d'/v0) + c d',   never negative (no pull),

so that a joint takes any of them. d is the penetration in m, d' its rate, v0 the approach speed latched at
the onset of the contact."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from sim_twin.compiled import inlined, written_twice
from sim_twin.vector import Vector, power, root, signed, touches, where_positive

_LEAST_RAMP = 1e-300


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


def _power(d: float, exponent: float) -> float:
    if exponent == 1.5:
        return d * sqrt(d)
    return d if exponent == 1.0 else float(d**exponent)


def _powers(d: Vector, exponent: Vector) -> Vector:
    made = where_positive(exponent - 1.25, d * root(d), d)  # of 1.5 and of 1
    other = abs(abs(exponent - 1.25) - 0.25)
    if touches(other):  # which takes much longer
        made = where_positive(other, power(d, exponent), made)
    return made


_to_the_power = written_twice(_power, _powers)


@inlined
def contact_forces(law: ContactLaw, d: float, rate: float, v0: float) -> tuple[float, float]:
    """Normal force in N, and K d^n alone, at penetration `d` m, its `rate` m/s, approached at `v0` m/s.

    Both are zero without penetration and where `v0` is 0: the contact is open.
    """
    elastic = law.stiffness * _to_the_power(max(d, 0.0), law.exponent)
    latched = where_positive(v0, v0, 1.0)
    force = max(0.0, elastic * (1.0 + (law.hysteresis / latched) * rate) + law.damping * rate)
    touching = where_positive(d, v0, 0.0)
    return where_positive(touching, force, 0.0), where_positive(touching, elastic, 0.0)


@inlined
def friction_share(friction: Friction, v: float) -> float:
    """Friction force over normal force, against the sliding velocity `v` in m/s (seed 001 eq. 12-13)."""
    ramp = (abs(v) - friction.v_0) / max(friction.v_1 - friction.v_0, _LEAST_RAMP)
    return float(-signed(friction.coefficient * min(max(ramp, 0.0), 1.0), v))
