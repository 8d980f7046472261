"""Parameters of the spatial slider-crank, with the values of its source as defaults.

Seed 000 (Deck and Dubowsky), section 4, tables 4 and 5; what it leaves open is chosen in
docs/decisions/0005-spatial-slider-crank.md. The guide lies along x, z is its upper side; the slider stands on
the positive side of the crank. At angle 90 degrees the crank's axis is y.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from math import pi
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

from daq.errors import UnphysicalParameter
from daq.quantity import Bound, Flat, Key, Quantity, Source, Whole, part_checks, rule
from sim_twin.contact import ContactLaw, Friction, linear
from sim_twin.effects import BaseMass
from sim_twin.joints.spatial import PrismaticJoint, SphericalJoint
from sim_twin.parts.beam import MOST_BENDING_MODES, Rod
from sim_twin.ranges import require, require_bounds
from sim_twin.rigs.spatial_slider_crank.channels import CHANNELS

if TYPE_CHECKING:
    from sim_twin.rigs.rig_model import RigModel

OWNER = "spatial_slider_crank"
_PAPER: Final = "Deck and Dubowsky"
_HALF = "half of the free motion"
_TABLE_4, _TABLE_5 = Source(f"{_PAPER}, table 4"), Source(f"{_PAPER}, table 5")
RIGID_ROTATIONS = 2
_PLATE: Final = 0.56, 0.46, 0.013
"""Length, width and thickness of the base plate (table 4), m."""


@dataclass(frozen=True, slots=True)
class Slider:
    """`mass` in kg, principal moments of `inertia` in kg m2 about its centre, in its own axes.

    `pin` in m is the universal joint's place from the centre: above the guide.
    """

    mass: Annotated[float, Bound("kg", 0.0, above=True)] = 0.35
    inertia: Annotated[
        tuple[float, float, float], Quantity("kg m^2", 1e-9, 10), Bound("kg m2", 0.0, above=True)
    ] = (
        5.3e-5,
        1.31e-4,
        1.31e-4,
    )
    pin: Annotated[tuple[float, float, float], Quantity("mm", -100, 100)] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        require_bounds("slider", self)


@dataclass(frozen=True, slots=True)
class SpatialSliderCrank:
    """The rig, in SI.

    `crank_radius` in m; `axis_angle` between the crank's axis and the guide in rad; clearances in m, half the
    free motion. `rod_modes` counts as the source does, the rod's two rigid rotations included: 8 are three
    bending modes in each plane; 0 is a rigid rod. `modal_damping` is the ratio of every bending mode.
    `gravity` in m/s2; the guide is inclined by `incline` rad, the crank at its upper end, and rolled about
    itself by `roll` rad: gravity acts along (sin i, -cos i sin r, -cos i cos r). The marker rises at crank
    angle `marker_angle` (rad).
    """

    kind: ClassVar[str] = "spatial_slider_crank"

    crank_radius: Annotated[float, Quantity("mm", 1, 1000), _TABLE_4] = 0.05
    axis_angle: Annotated[float, Quantity("deg", 65, 90), _TABLE_4, Bound("rad", pi / 6, 5 * pi / 6)] = pi / 2
    rod: Annotated[Rod, Flat("rod_", source=f"{_PAPER}, table 4; E and density assumed")] = field(
        default_factory=Rod
    )
    rod_modes: Annotated[
        int,
        Whole(0, 40),
        Source(f"{_PAPER}, section 4C"),
        Bound("", 0, RIGID_ROTATIONS + 2 * MOST_BENDING_MODES),
    ] = 8
    modal_damping: Annotated[float, Quantity("", 0, 0.5), Bound("", 0.0, 1.0)] = 0.01
    slider: Annotated[Slider, Flat("slider_")] = field(default_factory=Slider)
    socket_clearance: Annotated[float, Quantity("mm", 0, 2, means=_HALF), _TABLE_4] = 0.25e-3
    socket_stiffness: Annotated[
        float, Quantity("N/m", 1e3, 1e11), _TABLE_5, Bound("N/m", 0.0, above=True)
    ] = 2.8e7
    socket_damping: Annotated[float, Quantity("N s/m", 0, 1e5), _TABLE_5, Bound("N s/m", 0.0)] = 44.0
    guide_half_side: Annotated[float, Quantity("mm", 0.5, 200), _TABLE_4] = 6.5e-3
    guide_clearance: Annotated[float, Quantity("mm", 0, 2, means=_HALF), _TABLE_4] = 0.25e-3
    guide_stiffness: Annotated[float, Quantity("N/m", 1e3, 1e11), _TABLE_5, Bound("N/m", 0.0, above=True)] = (
        1.4e7
    )
    guide_damping: Annotated[float, Quantity("N s/m", 0, 1e5), _TABLE_5, Bound("N s/m", 0.0)] = 51.0
    contact_span: Annotated[float, Quantity("mm", 1, 500)] = 25e-3
    contact_offset: Annotated[float, Quantity("mm", 0, 200)] = 4e-3
    friction: Annotated[float, Quantity("", 0, 1), Bound("", 0.0, 2.0)] = 0.07
    friction_ramp: Annotated[tuple[float, float], Quantity("mm/s", 0, 10_000)] = (1e-4, 1e-3)
    gravity: Annotated[float, Quantity("m/s^2", 0, 100), Bound("m/s2", 0.0, 100.0)] = 9.81
    incline: Annotated[float, Quantity("deg", -180, 180), Bound("rad", -pi, pi)] = 69 * pi / 180
    roll: Annotated[float, Quantity("deg", -180, 180), Bound("rad", -pi, pi)] = 10 * pi / 180
    marker_angle: float = 0.0
    base: Annotated[BaseMass | None, Flat("base_")] = None
    """The guide on springs in y and z."""

    def __post_init__(self) -> None:
        require(OWNER, "crank_radius", self.crank_radius, 0.0, 0.9 * self.rod.length, "m", above=True)
        require_bounds(OWNER, self)
        if self.rod_modes % 2:
            raise UnphysicalParameter(
                OWNER, "rod_modes", self.rod_modes, "an even number: as many in each plane"
            )
        _ = self.socket, self.guide

    @property
    def model(self) -> RigModel:
        from sim_twin.rigs.spatial_slider_crank.rig import MODEL  # they are made of these parameters

        return MODEL

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(CHANNELS)

    @property
    def bending_modes(self) -> int:
        """Bending modes kept in each plane."""
        return max(0, self.rod_modes - RIGID_ROTATIONS) // 2

    @property
    def socket(self) -> SphericalJoint:
        return SphericalJoint(self.socket_clearance, linear(self.socket_stiffness, self.socket_damping))

    @property
    def guide(self) -> PrismaticJoint:
        law: ContactLaw = linear(self.guide_stiffness, self.guide_damping)
        friction = Friction(self.friction, *self.friction_ramp)
        return PrismaticJoint(
            self.guide_half_side, self.guide_clearance, self.contact_span, self.contact_offset, law, friction
        )


def _on_springs(key: str, model: Mapping[str, Any]) -> bool:
    return model["base"] == "flexible" or model[key] is None


def nominal(
    slider_mass: Annotated[float, Quantity("kg", 0.001, 10)] = 0.35,
    base: Annotated[Literal["rigid", "flexible"], Key()] = "rigid",
    plate_length: Annotated[float | None, Quantity("mm", 10, 5000, usual=560), _TABLE_4] = None,
    plate_width: Annotated[float | None, Quantity("mm", 10, 5000, usual=460), _TABLE_4] = None,
    plate_thickness: Annotated[float | None, Quantity("mm", 0.1, 200, usual=13), _TABLE_4] = None,
) -> SpatialSliderCrank:
    """Return the rig of the source; a block of another mass is of another material, inertia goes with it.

    How the source's aluminium plate is held it does not say: the mode of a flexible base is assumed. One of
    other dimensions (m) moves with a mass as l w t, at a frequency as t (1/l^2 + 1/w^2), as of a thin plate
    that is held at its edges.
    """
    longer, wider, thicker = (
        1.0 if given is None else given / own
        for given, own in zip((plate_length, plate_width, plate_thickness), _PLATE, strict=True)
    )
    length, width, _ = _PLATE
    bending = (longer * length) ** -2 + (wider * width) ** -2
    times = thicker * bending / (length**-2 + width**-2)
    springs = BaseMass(times * 400.0, longer * wider * thicker * 2.0, 0.02) if base == "flexible" else None
    block = Slider()
    if slider_mass == block.mass:
        return SpatialSliderCrank(base=springs)
    first, second, third = (moment * slider_mass / block.mass for moment in block.inertia)
    return SpatialSliderCrank(slider=Slider(slider_mass, (first, second, third)), base=springs)


CHECKS: Final = (
    *part_checks(SpatialSliderCrank, "base_", "base", "rigid"),
    *(
        rule(
            ("base", key),
            partial(_on_springs, key),
            key,
            'none, or with base = "flexible": a rigid one has no mode',
        )
        for key in ("plate_length", "plate_width", "plate_thickness")
    ),
)


def rig_of_the_figures() -> SpatialSliderCrank:
    """The rig with its crank's axis at 65 degrees: fully spatial; the source does not say the angle."""
    return SpatialSliderCrank(axis_angle=65 * pi / 180)
