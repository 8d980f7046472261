"""The spatial slider-crank as it really is in one run: nominal values, and what effects may change."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import pi

import numpy as np

from benchmarks.blind.crank.rig import Ripple
from benchmarks.blind.spatial.rod import Rod

POINTS = 8
FORCES = (*(f"slider.force_{point}" for point in range(1, POINTS + 1)), "socket.force")
TACHOMETER, MARKER = "motor.tachometer", "flywheel.marker"


@dataclass(frozen=True, slots=True)
class Contact:
    """F = stiffness d**exponent + damping d', never negative; N/m**exponent, N s/m."""

    stiffness: float
    damping: float
    exponent: float = 1.0


@dataclass(frozen=True, slots=True)
class Friction:
    """Coulomb's in the guide, setting in from 0.1 to 1 mm/s; at little speed it may be `more` (Stribeck).

    The share of that decays as exp(-speed/`fading`), `fading` in m/s.
    """

    coefficient: float = 0.07
    more: float = 0.0
    fading: float = 0.05


@dataclass(frozen=True, slots=True)
class Base:
    """The guide as a mass on springs across it: Hz, kg, damping ratio."""

    frequency: float
    mass: float
    damping_ratio: float


@dataclass(frozen=True, slots=True)
class Slider:
    """Mass in kg, principal moments of inertia in kg m2; `pin` (m): the universal joint from its centre."""

    mass: float = 0.35
    inertia: tuple[float, float, float] = (5.3e-5, 1.31e-4, 1.31e-4)
    pin: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Spatial:
    """SI; the guide along x, z its upper side, gravity along (sin i, -cos i sin r, -cos i cos r).

    Clearances are half the free motion. `span` and `offset`: the guide's contact points before and behind the
    slider's centre and beside the faces' middles. What follows is in no catalogue: `worn` (m) sets points
    back from the guide, `socket_friction` on a ball of 6 mm, `film` (N s/m) between ball and socket, `drag`
    (N s/m) and `spring` (N/m about 0.19 m) on the slider along the guide.
    """

    speed: float
    axis_angle: float = pi / 2
    socket_clearance: float = 0.25e-3
    guide_clearance: float = 0.25e-3
    ripple: Ripple = field(default_factory=Ripple)
    crank_radius: float = 0.05
    rod: Rod = field(default_factory=Rod)
    slider: Slider = field(default_factory=Slider)
    socket: Contact = Contact(2.8e7, 44.0)
    guide: Contact = Contact(1.4e7, 51.0)
    friction: Friction = Friction()
    half_side: float = 6.5e-3
    span: float = 25e-3
    offset: float = 4e-3
    gravity: float = 9.81
    incline: float = 69 * pi / 180
    roll: float = 10 * pi / 180
    base: Base | None = None

    worn: tuple[float, ...] = (0.0,) * POINTS
    socket_friction: float = 0.0
    film: float = 0.0
    drag: float = 0.0
    spring: float = 0.0


def toleranced(rig: Spatial, rng: np.random.Generator, wider: float = 1.0) -> Spatial:
    """The same rig as somebody built it, with tolerances so many times `wider`; always as many draws."""

    def about_one(spread: float) -> float:
        return 1 + wider * spread * float(np.clip(rng.standard_normal(), -3, 3))

    rod, mass = rig.rod, about_one(0.003)
    common = about_one(0.12)
    first, second, third = (mass * moment for moment in rig.slider.inertia)
    return replace(
        rig,
        crank_radius=rig.crank_radius * about_one(0.003),
        rod=replace(
            rod,
            modulus=rod.modulus * about_one(0.01),
            density=rod.density * about_one(0.005),
            diameter=rod.diameter * about_one(0.003),
            length=rod.length * about_one(0.003),
            damping=tuple(ratio * common * about_one(0.09) for ratio in rod.damping),
        ),
        slider=replace(rig.slider, mass=mass * rig.slider.mass, inertia=(first, second, third)),
        span=rig.span * about_one(0.003),
        socket_clearance=rig.socket_clearance * about_one(0.02),
        guide_clearance=rig.guide_clearance * about_one(0.02),
        socket=_touching(rig.socket, about_one(0.05), about_one(0.2)),
        guide=_touching(rig.guide, about_one(0.05), about_one(0.2)),
        friction=replace(
            rig.friction,
            coefficient=max(0.0, rig.friction.coefficient + 0.003 * (about_one(1.0) - 1)),
        ),
    )


def set_anew(rig: Spatial, rng: np.random.Generator) -> Spatial:
    """What differs from run to run: the speed."""
    return replace(rig, speed=rig.speed * (1 + 2e-4 * float(np.clip(rng.standard_normal(), -3, 3))))


def _touching(contact: Contact, stiffer: float, damped: float) -> Contact:
    return replace(contact, stiffness=contact.stiffness * stiffer, damping=contact.damping * damped)
