"""Parameters of the planar slider-crank, with the values of its source as defaults."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi, sqrt
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal

from daq.quantity import Bound, Each, Flat, Key, Quantity, Source, part_checks, rule
from sim_twin.parts.stuff import MODULUS, POISSON
from sim_twin.ranges import require, require_bounds
from sim_twin.rigs.planar_slider_crank.channels import CHANNELS, CRANK_X, CRANK_Y, PISTON_Y

if TYPE_CHECKING:
    from sim_twin.rigs.rig_model import RigModel
_RIG = "planar slider-crank"
_TABLE_1: Final = Source("Erkaya, table 1")
_BAR: Final = Source("of a square steel bar of the rod's length and mass")


@dataclass(frozen=True, slots=True)
class Elastic:
    """Elastic constants of a body: Young's modulus `E` in Pa and Poisson's ratio `nu`."""

    E: Annotated[float, MODULUS]
    nu: Annotated[float, POISSON]

    def __post_init__(self) -> None:
        require("material", "E", self.E, 0.0, unit="Pa", above=True)
        require("material", "nu", self.nu, -1.0, 0.5, above=True)

    @property
    def h(self) -> float:
        """(1 - nu^2) / E in 1/Pa (eq. 10)."""
        return (1.0 - self.nu**2) / self.E


def generalised_stiffness(R_i: float, R_j: float, i: Elastic, j: Elastic) -> float:
    """K in N/m^1.5 of radii in m, negative for a concave surface (eq. 9).

    Raises ValueError for a pair that does not touch at a point: two concave ones, or a hollow that is smaller
    than what lies in it.
    """
    curvature = 1.0 / R_i + 1.0 / R_j
    if curvature <= 0.0:
        raise ValueError(f"surfaces of radii {R_i:g} m and {R_j:g} m do not touch at a point")
    return 4.0 / (3.0 * (i.h + j.h)) * sqrt(1.0 / curvature)


@dataclass(frozen=True, slots=True)
class Material:
    """`elastic` constants, and `density` in kg/m3."""

    elastic: Elastic
    density: float


MATERIALS = {
    "steel": Material(Elastic(207e9, 0.3), 7800.0),
    "aluminium": Material(Elastic(70e9, 0.33), 2700.0),
    "brass": Material(Elastic(105e9, 0.34), 8500.0),
}
"""Of links and joints; the links' masses in Table 1 are those of steel. Common handbook values (assumed)."""


@dataclass(frozen=True, slots=True)
class FrameMode:
    """The frame under an accelerometer: an oscillator of `mass` kg, `frequency` Hz, `damping_ratio`."""

    mass: Annotated[float, Quantity("kg", 0.01, 10_000), Bound("kg", 0.0, above=True)]
    frequency: Annotated[float, Quantity("Hz", 1, 10_000), Bound("Hz", 0.0, above=True)]
    damping_ratio: Annotated[float, Quantity("", 0.0001, 0.5, key="damping"), Bound("", 0.0, 1.0)] = 0.03

    def __post_init__(self) -> None:
        require_bounds("frame", self)


@dataclass(frozen=True, slots=True)
class RodBending:
    """The rod's bending mode sin(pi s/L) between its joints: `frequency` Hz, `damping_ratio`."""

    frequency: Annotated[float, Quantity("Hz", 10, 10_000), _BAR, Bound("Hz", 0.0, above=True)]
    damping_ratio: Annotated[float, Quantity("", 0.0001, 0.5, key="damping"), Bound("", 0.0, 1.0)]

    def __post_init__(self) -> None:
        require_bounds("rod", self)


@dataclass(frozen=True, slots=True)
class PlanarSliderCrank:
    """The rig, in SI (Table 1 of the source; what it leaves open is assumed).

    `clearance_1` (crank pin) and `clearance_2` (piston pin) are radial and above 0: the stiffness of eq. 9
    grows without end as a journal fills its bearing, and a joint without clearance is a constraint, which
    these equations of motion do not have. `stiffness_scales` multiply the two contact stiffnesses of eq. 9.
    Centres of mass lie at the fractions `crank_centre`, `rod_centre` of the lengths. Joint friction sets in
    between the sliding speeds `friction_v_0` and `friction_v_1`; the guide's ramp is `guide_v_1` wide.
    `approach_floor` is the least approach speed that a contact latches. The marker rises at crank angle
    `marker_angle` (rad). The guide is inclined by `incline` rad, the crank at its upper end: gravity acts
    along (sin i, -cos i).
    """

    kind: ClassVar[str] = "planar_slider_crank"

    clearance_1: Annotated[
        float,
        Quantity("mm", 0.001, 10, means="radial, of the crank pin: half of its free motion"),
        Source("Erkaya, section 3"),
        Bound("m", 0.0, above=True),
    ] = 1e-3
    clearance_2: Annotated[
        float,
        Quantity("mm", 0.001, 10, means="radial, of the piston pin: half of its free motion"),
        Source("Erkaya, section 3"),
        Bound("m", 0.0, above=True),
    ] = 1e-3
    restitution: Annotated[float, Quantity("", 0.05, 1), Bound("", 0.0, 1.0)] = 0.9
    friction: Annotated[float, Quantity("", 0, 1), Bound("", 0.0)] = 0.01
    journal_radius: Annotated[float, Quantity("mm", 1, 100), Bound("m", 0.0, above=True)] = 10e-3
    crank_length: Annotated[float, Quantity("m", 0.01, 2), _TABLE_1, Bound("m", 0.0, above=True)] = 0.150
    rod_length: Annotated[float, Quantity("m", 0.02, 5), _TABLE_1] = 0.564
    crank_mass: Annotated[float, Quantity("kg", 0.001, 100), _TABLE_1, Bound("kg", 0.0)] = 0.4506
    rod_mass: Annotated[float, Quantity("kg", 0.001, 100), _TABLE_1, Bound("kg", 0.0, above=True)] = 1.6403
    piston_mass: Annotated[float, Quantity("kg", 0.001, 100), _TABLE_1, Bound("kg", 0.0, above=True)] = 2.0205
    crank_inertia: Annotated[float, Quantity("kg m^2", 1e-7, 100), _TABLE_1, Bound("kg m2", 0.0)] = 1.8e-3
    rod_inertia: Annotated[
        float, Quantity("kg m^2", 1e-7, 100), _TABLE_1, Bound("kg m2", 0.0, above=True)
    ] = 9.45e-2
    gravity: Annotated[float, Quantity("m/s^2", 0, 100), Bound("m/s2", 0.0)] = 9.81
    incline: Annotated[float, Quantity("deg", -180, 180), Bound("rad", -pi, pi)] = 0.0
    crank_centre: Annotated[float, Quantity("", 0, 1), Bound("", 0.0, 1.0)] = 0.5
    rod_centre: Annotated[float, Quantity("", 0, 1), Bound("", 0.0, 1.0)] = 0.5
    elastic: Annotated[Elastic, Flat("joint_", source="handbook, by the material")] = MATERIALS[
        "steel"
    ].elastic
    stiffness_scales: Annotated[
        tuple[float, float],
        Quantity("", 0.01, 100, key="joint_stiffness_scales"),
        Bound("", 0.0, above=True),
    ] = (1.0, 1.0)
    friction_v_0: Annotated[float, Quantity("mm/s", 0, 1000), Bound("", 0.0)] = 1e-4
    friction_v_1: Annotated[float, Quantity("mm/s", 0, 10_000, above=True)] = 1e-3
    approach_floor: Annotated[float, Quantity("mm/s", 0.01, 1000), Bound("m/s", 0.0, above=True)] = 0.01
    guide_friction: Annotated[float, Quantity("", 0, 1), Bound("", 0.0)] = 0.0
    guide_v_1: Annotated[float, Quantity("mm/s", 0.01, 1000), Bound("m/s", 0.0, above=True)] = 1e-3
    bending: Annotated[RodBending | None, Flat("rod_bending_")] = None
    marker_angle: float = 0.0
    frames: Annotated[
        dict[str, FrameMode],
        Each({CRANK_Y: "frame_crank_y_", CRANK_X: "frame_crank_x_", PISTON_Y: "frame_piston_y_"}),
    ] = field(
        default_factory=lambda: {
            CRANK_Y: FrameMode(30.0, 230.0),
            CRANK_X: FrameMode(30.0, 180.0),
            PISTON_Y: FrameMode(30.0, 310.0),
        }
    )

    def __post_init__(self) -> None:
        require_bounds(_RIG, self)
        shortest = self.crank_length + self.clearance_1 + self.clearance_2
        require(_RIG, "rod_length", self.rod_length, shortest, unit="m", above=True)
        require(_RIG, "friction_v_1", self.friction_v_1, self.friction_v_0, unit="m/s", above=True)

    @property
    def model(self) -> RigModel:
        from sim_twin.rigs.planar_slider_crank.rig import MODEL  # they are made of these parameters

        return MODEL

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(CHANNELS)

    @property
    def contact_stiffnesses(self) -> tuple[float, float]:
        """K of crank pin and piston pin in N/m^1.5 (eq. 9-10), the bearing concave."""
        first, second = (
            scale * generalised_stiffness(
                self.journal_radius, -(self.journal_radius + clearance), self.elastic, self.elastic
            )
            for scale, clearance in zip(
                self.stiffness_scales, (self.clearance_1, self.clearance_2), strict=True
            )
        )  # fmt: skip
        return first, second


def nominal(
    material: Annotated[Literal["steel", "aluminium", "brass"], Key()] = "steel",
    rod: Annotated[Literal["rigid", "flexible"], Key()] = "rigid",
) -> PlanarSliderCrank:
    """Return the rig of the source with links and joints of a material: masses go with the density.

    Its rod is rigid; a flexible one has its lowest bending mode.
    """
    of = MATERIALS[material]
    ratio, steel = of.density / MATERIALS["steel"].density, PlanarSliderCrank()
    return PlanarSliderCrank(
        crank_mass=ratio * steel.crank_mass,
        rod_mass=ratio * steel.rod_mass,
        piston_mass=ratio * steel.piston_mass,
        crank_inertia=ratio * steel.crank_inertia,
        rod_inertia=ratio * steel.rod_inertia,
        elastic=of.elastic,
        bending=RodBending(140.0, 0.01) if rod == "flexible" else None,
    )


CHECKS: Final = (
    rule(
        ("friction_v_0", "friction_v_1"),
        lambda model: model["friction_v_1"] > model["friction_v_0"],
        ("friction_v_1", "friction_v_0"),
        "friction_v_1 above friction_v_0: {friction_v_1:g} and {friction_v_0:g} m/s",
    ),
    rule(
        ("crank_length", "rod_length"),
        lambda model: model["rod_length"] > model["crank_length"],
        ("rod_length", "crank_length"),
        "a rod longer than the crank, or it cannot turn over: {rod_length:g} m and {crank_length:g} m",
    ),
    *part_checks(PlanarSliderCrank, "rod_bending_", "rod", "rigid"),
)
"""Of what may be asked for together."""
