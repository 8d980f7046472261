"""The planar slider-crank as it really is in one run: nominal values, and what effects may change."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

YOUNG, POISSON = 207e9, 0.3
JOURNAL_RADIUS = 0.010
ROD_INERTIA, ROD_MASS, ROD_LENGTH = 9.45e-2, 1.6403, 0.564
FRAME_MASS = 30.0
_TYPICAL_DEPTH = 5e-6
CRANK_X, CRANK_Y = "crank_frame.acceleration_x", "crank_frame.acceleration_y"
PISTON_Y = "piston_frame.acceleration_y"
Pair: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Mode:
    """One oscillator: frequency in Hz, damping ratio."""

    frequency: float
    damping_ratio: float


@dataclass(frozen=True, slots=True)
class Ripple:
    """The crank turns at speed (1 + amplitude sin(order angle + phase))."""

    amplitude: float = 0.0
    order: float = 1.0
    phase: float = 0.0


def _frames() -> dict[str, Mode]:
    return {CRANK_Y: Mode(230.0, 0.03), CRANK_X: Mode(180.0, 0.03), PISTON_Y: Mode(310.0, 0.03)}


@dataclass(frozen=True, slots=True)
class Crank:
    """SI units; pairs are crank pin and piston pin. The last group is what no catalogue holds.

    `bending` is the rod's first mode on its chord; `ovality` (m) how far the two halves of a lemon-bore
    bearing are moved towards each other; `exponent` of the contacts, as strong as the nominal one at 5 um;
    `stribeck` (share, m/s): so much more friction in the joints at rest, gone in a straight line at that
    speed; `film` (N s/m) an oil film's damping between journal and bearing; `guide_offset` how far the
    slider's axis passes beside the crank's; `air_spring` (N/m about mid stroke) and `drag` (N s/m) act on the
    piston.
    """

    speed: float
    clearances: Pair = (1e-3, 1e-3)
    ripple: Ripple = Ripple()
    crank_length: float = 0.150
    crank_mass: float = 0.4506
    rod_length: float = ROD_LENGTH
    rod_mass: float = ROD_MASS
    piston_mass: float = 2.0205
    stiffness_scales: Pair = (1.0, 1.0)
    restitution: float = 0.9
    friction: float = 0.01
    guide_friction: float = 0.0
    bending: Mode | None = None
    gravity: float = 9.81
    frames: dict[str, Mode] = field(default_factory=_frames)

    ovality: Pair = (0.0, 0.0)
    exponent: float = 1.5
    stribeck: Pair = (0.0, 0.0)
    film: float = 0.0
    guide_offset: float = 0.0
    air_spring: float = 0.0
    drag: float = 0.0

    @property
    def rod_inertia(self) -> float:
        """About the centre of mass; goes with mass and length squared."""
        return ROD_INERTIA * self.rod_mass / ROD_MASS * (self.rod_length / ROD_LENGTH) ** 2

    @property
    def contact_stiffnesses(self) -> Pair:
        """N/m^1.5, journal in a bearing that is wider by the clearance (Hertz)."""
        first, second = (
            scale * hertz_stiffness(c)
            for scale, c in zip(self.stiffness_scales, self.clearances, strict=True)
        )
        return first, second

    def joint_stiffness(self, which: int) -> float:
        """Of the first or second joint, N/m^exponent."""
        return float(self.contact_stiffnesses[which] * _TYPICAL_DEPTH ** (1.5 - self.exponent))


def hertz_stiffness(clearance: float) -> float:
    """N/m^1.5: 4 sqrt(R) / (3 (2 sigma)) with 1/R = 1/journal - 1/bearing and sigma = (1 - nu^2)/E."""
    bearing = JOURNAL_RADIUS + clearance
    relative = JOURNAL_RADIUS * bearing / clearance
    return float(4 * np.sqrt(relative) / (6 * (1 - POISSON**2) / YOUNG))


def toleranced(crank: Crank, rng: np.random.Generator, wider: float = 1.0) -> Crank:
    """The same rig as somebody built it, with tolerances so many times `wider`; always as many draws."""
    e, mu = (
        crank.restitution + 0.02 * wider * rng.standard_normal(),
        crank.friction + 0.003 * wider * rng.standard_normal(),
    )
    return replace(
        crank,
        crank_length=crank.crank_length * _about_one(rng, 0.003 * wider),
        crank_mass=crank.crank_mass * _about_one(rng, 0.003 * wider),
        rod_length=crank.rod_length * _about_one(rng, 0.003 * wider),
        rod_mass=crank.rod_mass * _about_one(rng, 0.003 * wider),
        piston_mass=crank.piston_mass * _about_one(rng, 0.003 * wider),
        clearances=_jittered(crank.clearances, rng, 0.02 * wider),
        stiffness_scales=_jittered(crank.stiffness_scales, rng, 0.05 * wider),
        restitution=float(np.clip(e, 0.05, 0.99)),
        friction=max(float(mu), 0.0),
        frames={
            name: Mode(
                mode.frequency * _about_one(rng, 0.01 * wider),
                mode.damping_ratio * _about_one(rng, 0.15 * wider),
            )
            for name, mode in crank.frames.items()
        },
    )


def set_anew(crank: Crank, rng: np.random.Generator) -> Crank:
    """What differs from run to run: the speed."""
    return replace(crank, speed=crank.speed * _about_one(rng, 2e-4))


def _about_one(rng: np.random.Generator, spread: float) -> float:
    return float(max(1 + spread * rng.standard_normal(), 0.1))


def _jittered(pair: Pair, rng: np.random.Generator, spread: float) -> Pair:
    return pair[0] * _about_one(rng, spread), pair[1] * _about_one(rng, spread)
