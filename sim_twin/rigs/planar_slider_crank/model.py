"""Parameters of the planar slider-crank, with the values of its source as defaults."""

from __future__ import annotations

from dataclasses import dataclass, field

from sim_twin.contact.stiffness import Elastic, generalised_stiffness
from sim_twin.ranges import require
from sim_twin.rigs.planar_slider_crank.channels import CHANNELS, CRANK_X, CRANK_Y, PISTON_Y

_RIG = "planar slider-crank"


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

    mass: float
    frequency: float
    damping_ratio: float = 0.03

    def __post_init__(self) -> None:
        require("frame", "mass", self.mass, 0.0, unit="kg", above=True)
        require("frame", "frequency", self.frequency, 0.0, unit="Hz", above=True)
        require("frame", "damping_ratio", self.damping_ratio, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class RodBending:
    """The rod's bending mode sin(pi s/L) between its joints: `frequency` Hz, `damping_ratio`."""

    frequency: float
    damping_ratio: float

    def __post_init__(self) -> None:
        require("rod", "frequency", self.frequency, 0.0, unit="Hz", above=True)
        require("rod", "damping_ratio", self.damping_ratio, 0.0, 1.0)


def _frames() -> dict[str, FrameMode]:
    return {
        CRANK_Y: FrameMode(30.0, 230.0),
        CRANK_X: FrameMode(30.0, 180.0),
        PISTON_Y: FrameMode(30.0, 310.0),
    }


@dataclass(frozen=True, slots=True)
class PlanarSliderCrank:
    """The rig, in SI (Table 1 of the source; what it leaves open is assumed).

    `clearance_1` (crank pin) and `clearance_2` (piston pin) are radial; `stiffness_scales` multiply the two
    contact stiffnesses of eq. 9. Centres of mass lie at the fractions `crank_centre`, `rod_centre` of the
    lengths. Joint friction sets in between the sliding speeds `friction_v_0` and `friction_v_1`; the guide's
    ramp is `guide_v_1` wide. `approach_floor` is the least approach speed that a contact latches.
    """

    crank_length: float = 0.150
    rod_length: float = 0.564
    crank_mass: float = 0.4506
    rod_mass: float = 1.6403
    piston_mass: float = 2.0205
    crank_inertia: float = 1.8e-3
    rod_inertia: float = 9.45e-2
    crank_centre: float = 0.5
    rod_centre: float = 0.5
    gravity: float = 9.81
    clearance_1: float = 1e-3
    clearance_2: float = 1e-3
    journal_radius: float = 10e-3
    elastic: Elastic = MATERIALS["steel"].elastic
    stiffness_scales: tuple[float, float] = (1.0, 1.0)
    restitution: float = 0.9
    friction: float = 0.01
    friction_v_0: float = 1e-4
    friction_v_1: float = 1e-3
    approach_floor: float = 0.01
    guide_friction: float = 0.0
    guide_v_1: float = 1e-3
    bending: RodBending | None = None
    frames: dict[str, FrameMode] = field(default_factory=_frames)

    def __post_init__(self) -> None:
        for name in ("crank_length", "clearance_1", "clearance_2", "journal_radius", "approach_floor"):
            require(_RIG, name, getattr(self, name), 0.0, unit="m/s" if "floor" in name else "m", above=True)
        shortest = self.crank_length + self.clearance_1 + self.clearance_2
        require(_RIG, "rod_length", self.rod_length, shortest, unit="m", above=True)
        for name in ("rod_mass", "piston_mass"):
            require(_RIG, name, getattr(self, name), 0.0, unit="kg", above=True)
        require(_RIG, "crank_mass", self.crank_mass, 0.0, unit="kg")
        require(_RIG, "crank_inertia", self.crank_inertia, 0.0, unit="kg m2")
        require(_RIG, "rod_inertia", self.rod_inertia, 0.0, unit="kg m2", above=True)
        for name in ("crank_centre", "rod_centre"):
            require(_RIG, name, getattr(self, name), 0.0, 1.0)
        require(_RIG, "gravity", self.gravity, 0.0, unit="m/s2")
        require(_RIG, "restitution", self.restitution, 0.0, 1.0)
        self._check_friction()

    def _check_friction(self) -> None:
        for name in ("friction", "guide_friction", "friction_v_0"):
            require(_RIG, name, getattr(self, name), 0.0)
        require(_RIG, "friction_v_1", self.friction_v_1, self.friction_v_0, unit="m/s", above=True)
        require(_RIG, "guide_v_1", self.guide_v_1, 0.0, unit="m/s", above=True)
        for scale in self.stiffness_scales:
            require(_RIG, "stiffness_scales", scale, 0.0, above=True)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that its twin predicts."""
        return CHANNELS

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


def nominal(material: str = "steel") -> PlanarSliderCrank:
    """Return the rig of the source with links and joints of a material: masses go with the density."""
    of = MATERIALS[material]
    ratio, steel = of.density / MATERIALS["steel"].density, PlanarSliderCrank()
    return PlanarSliderCrank(
        crank_mass=ratio * steel.crank_mass,
        rod_mass=ratio * steel.rod_mass,
        piston_mass=ratio * steel.piston_mass,
        crank_inertia=ratio * steel.crank_inertia,
        rod_inertia=ratio * steel.rod_inertia,
        elastic=of.elastic,
    )
