"""Parameters of the spatial slider-crank, with the values of its source as defaults.

Seed 000 (Deck and Dubowsky), section 4, tables 4 and 5; what it leaves open is chosen in
docs/decisions/0005-spatial-slider-crank.md. The guide lies along x, z is its upper side; the slider stands on
the positive side of the crank. At angle 90 degrees the crank's axis is y.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi

from daq.errors import UnphysicalParameter
from sim_twin.contact.laws import ContactLaw, Friction, linear
from sim_twin.joints.spatial_prismatic import PrismaticJoint
from sim_twin.joints.spherical import SphericalJoint
from sim_twin.parts.rod import MOST_BENDING_MODES, Rod
from sim_twin.ranges import require
from sim_twin.rigs.spatial_slider_crank.channels import CHANNELS

OWNER = "spatial_slider_crank"
RIGID_ROTATIONS = 2


@dataclass(frozen=True, slots=True)
class Slider:
    """`mass` in kg, principal moments of `inertia` in kg m2 about its centre, in its own axes.

    `pin` in m is the universal joint's place from the centre: above the guide.
    """

    mass: float = 0.35
    inertia: tuple[float, float, float] = (5.3e-5, 1.31e-4, 1.31e-4)
    pin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        require("slider", "mass", self.mass, 0.0, unit="kg", above=True)
        for moment in self.inertia:
            require("slider", "inertia", moment, 0.0, unit="kg m2", above=True)


@dataclass(frozen=True, slots=True)
class BaseMass:
    """The guide as a mass on springs in y and z: `frequency` Hz, `mass` kg, `damping_ratio`."""

    frequency: float
    mass: float
    damping_ratio: float

    def __post_init__(self) -> None:
        require("base", "frequency", self.frequency, 0.0, unit="Hz", above=True)
        require("base", "mass", self.mass, 0.0, unit="kg", above=True)
        require("base", "damping_ratio", self.damping_ratio, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class SpatialSliderCrank:
    """The rig, in SI.

    `crank_radius` in m; `axis_angle` between the crank's axis and the guide in rad; clearances in m, half the
    free motion. `rod_modes` counts as the source does, the rod's two rigid rotations included: 8 are three
    bending modes in each plane; 0 is a rigid rod. `modal_damping` is the ratio of every bending mode.
    `gravity` in m/s2; the guide is inclined by `incline` rad, the crank at its upper end, and rolled about
    itself by `roll` rad: gravity acts along (sin i, -cos i sin r, -cos i cos r).
    """

    crank_radius: float = 0.05
    axis_angle: float = pi / 2
    rod: Rod = field(default_factory=Rod)
    rod_modes: int = 8
    modal_damping: float = 0.01
    slider: Slider = field(default_factory=Slider)
    socket_clearance: float = 0.25e-3
    socket_stiffness: float = 2.8e7
    socket_damping: float = 44.0
    guide_half_side: float = 6.5e-3
    guide_clearance: float = 0.25e-3
    guide_stiffness: float = 1.4e7
    guide_damping: float = 51.0
    contact_span: float = 25e-3
    contact_offset: float = 4e-3
    friction: float = 0.07
    friction_ramp: tuple[float, float] = (1e-4, 1e-3)
    gravity: float = 9.81
    incline: float = 69 * pi / 180
    roll: float = 10 * pi / 180
    base: BaseMass | None = None

    def __post_init__(self) -> None:
        require(OWNER, "crank_radius", self.crank_radius, 0.0, 0.9 * self.rod.length, "m", above=True)
        require(OWNER, "axis_angle", self.axis_angle, pi / 6, 5 * pi / 6, "rad")
        require(OWNER, "rod_modes", self.rod_modes, 0, RIGID_ROTATIONS + 2 * MOST_BENDING_MODES)
        if self.rod_modes % 2:
            raise UnphysicalParameter(
                OWNER, "rod_modes", self.rod_modes, "an even number: as many in each plane"
            )
        require(OWNER, "modal_damping", self.modal_damping, 0.0, 1.0)
        require(OWNER, "gravity", self.gravity, 0.0, 100.0, "m/s2")
        require(OWNER, "friction", self.friction, 0.0, 2.0)
        for name, unit in _STIFFNESSES:
            require(OWNER, name, getattr(self, name), 0.0, unit=unit, above=True)
        for name in ("socket_damping", "guide_damping"):
            require(OWNER, name, getattr(self, name), 0.0, unit="N s/m")
        require(OWNER, "incline", self.incline, -pi, pi, "rad")
        require(OWNER, "roll", self.roll, -pi, pi, "rad")
        _ = self.socket, self.guide

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that a twin of it predicts."""
        return CHANNELS

    @property
    def bending_modes(self) -> int:
        """Bending modes kept in each plane."""
        return max(0, self.rod_modes - RIGID_ROTATIONS) // 2

    @property
    def socket(self) -> SphericalJoint:
        """Ball joint at the crank."""
        return SphericalJoint(self.socket_clearance, linear(self.socket_stiffness, self.socket_damping))

    @property
    def guide(self) -> PrismaticJoint:
        """Slider on its guide."""
        law: ContactLaw = linear(self.guide_stiffness, self.guide_damping)
        friction = Friction(self.friction, *self.friction_ramp)
        return PrismaticJoint(
            self.guide_half_side, self.guide_clearance, self.contact_span, self.contact_offset, law, friction
        )


_STIFFNESSES = (("socket_stiffness", "N/m"), ("guide_stiffness", "N/m"))


def rig_of_the_figures() -> SpatialSliderCrank:
    """The rig with its crank's axis at 65 degrees: fully spatial; the source does not say the angle."""
    return SpatialSliderCrank(axis_angle=65 * pi / 180)
