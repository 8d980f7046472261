"""Parameters of the impact beam, with the values of its source as defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import pi
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from daq.quantity import Bound, Flat, Key, Quantity, Source, Whole, part_checks, rule
from sim_twin.effects import BaseMass
from sim_twin.parts.beam import Beam
from sim_twin.ranges import require, require_bounds
from sim_twin.rigs.impact_beam.base.model import FlexibleBase, flexible_base
from sim_twin.rigs.impact_beam.channels import channel_names

if TYPE_CHECKING:
    from sim_twin.rigs.rig_model import RigModel

FLEXURE_ROTATION = 0.16
"""N m/rad: EI/l of the flexure 4 x 19 x 0.127 mm, whose dimensions the source states (table 1)."""
FLEXURE_TRANSLATION = 1.258e5
"""N/m: 12 EI/l^3 of the same flexure."""
_FLEXURE: Final = 4e-3, 19e-3, 0.127e-3
"""Its length, width and thickness, m."""


_PAPER: Final = "Deck and Dubowsky"
_TABLE_1, _TABLE_2 = Source(f"{_PAPER}, table 1"), Source(f"{_PAPER}, table 2")
_LOWEST_MODES: Final = Source("of the lowest modes, one by one; those above have modal_damping")


@dataclass(frozen=True, slots=True)
class ImpactBeam:
    """The rig, in SI.

    `clearance` g is half the free motion of the tip, `rest_offset` where the tip rests (towards the upper
    stop): with gravity, which bends the beam as a constant force does and changes nothing else of its motion.
    `modal_damping` has one ratio for each mode kept. `pivot_stiffness` (N/m) None is the ideal pin.
    `hertz` (N/m^1.5) replaces the linear `contact_stiffness`. `pivot_friction` is a Coulomb torque in N m.
    `yoke_frequency` is the impedance head's mode. `stations` (percent of L) carry accelerometers.
    The drive's force is the coil's, or with a `stinger_gauge` what of it goes on to the beam.
    """

    kind: ClassVar[str] = "impact_beam"

    beam: Annotated[Beam, Flat("beam_", source=f"{_PAPER}, table 1; E and density assumed")]
    clamped: Annotated[bool, Key(), Source(f"{_PAPER}, section 3A")]
    contact_stiffness: Annotated[float, Quantity("N/m", 1e3, 1e10), _TABLE_2, Bound("N/m", 0.0)]
    contact_damping: Annotated[float, Quantity("N s/m", 0, 1e5), _TABLE_2, Bound("N s/m", 0.0)]
    modal_damping: Annotated[tuple[float, ...], Bound("", 0.0, 1.0)]
    clearance: Annotated[
        float,
        Quantity("mm", 0, 10, means="half of the tip's free motion between the stops"),
        Source(f"{_PAPER}, figure 7"),
        Bound("m", 0.0),
    ] = 0.127e-3
    rest_offset: Annotated[
        float,
        Quantity("mm", -10, 10, means="where the tip rests, from the middle towards the upper stop"),
        Source("centred; where gravity lets it rest, counts"),
    ] = 0.0
    rotation_stiffness: Annotated[
        float,
        Quantity("N m/rad", 1e-6, 1e4, key="pivot_rotation_stiffness"),
        Source(f"EI/l of the flexure in {_PAPER}, table 1"),
        Bound("N m/rad", 0.0, above=True),
    ] = FLEXURE_ROTATION
    pivot_stiffness: Annotated[
        float | None,
        Quantity("N/m", 1e2, 1e10),
        Source(f"12 EI/l^3 of the flexure in {_PAPER}, table 1; without it an ideal pin"),
        Bound("N/m", 0.0, above=True),
    ] = None
    drive_position: Annotated[
        float, Quantity("", 0.01, 1, means="fraction of the length from the pivot"), Bound("L", 0.0, 1.0)
    ] = 0.69
    shaker_mass: Annotated[float, Quantity("kg", 0, 10), Bound("kg", 0.0)] = 0.0
    shaker_stiffness: Annotated[float, Quantity("N/m", 0, 1e7), Bound("N/m", 0.0)] = 0.0
    shaker_damping: Annotated[float, Quantity("N s/m", 0, 1e4), Bound("N s/m", 0.0)] = 0.0
    hertz: Annotated[
        float | None,
        Quantity(
            "", 1e5, 1e13, key="contact_hertz", means="of curved surfaces, N/m^1.5, for contact_stiffness"
        ),
        Bound("N/m^1.5", 0.0, above=True),
    ] = None
    pivot_friction: Annotated[float, Quantity("N m", 0, 10), Bound("N m", 0.0)] = 0.0
    base: Annotated[BaseMass | FlexibleBase | None, Flat("base_", part=FlexibleBase)] = None
    yoke_frequency: Annotated[float, Quantity("Hz", 10, 20_000), Bound("Hz", 0.0, above=True)] = 700.0
    yoke_damping: Annotated[float, Quantity("", 0.0001, 0.5), Bound("", 0.0, 1.0)] = 0.03
    stations: tuple[int, ...] = ()
    stinger_gauge: bool = False

    def __post_init__(self) -> None:
        require_bounds("ImpactBeam", self)
        slides = not self.clamped and self.pivot_stiffness is not None
        require("ImpactBeam", "modes", self.modes, 1, freedoms(self.beam.elements, self.clamped) + slides)
        require("ImpactBeam", "rest_offset", abs(self.rest_offset), 0.0, self.clearance, "m")

    @property
    def model(self) -> RigModel:
        from sim_twin.rigs.impact_beam.rig import MODEL  # they are made of these parameters

        return MODEL

    @property
    def channels(self) -> tuple[str, ...]:
        covered = isinstance(self.base, FlexibleBase) and self.base.cover is not None
        return channel_names(self.stations, covered)

    @property
    def modes(self) -> int:
        return len(self.modal_damping)


def freedoms(elements: int, clamped: bool) -> int:
    """Degrees of freedom of the mesh: two a node; the pin takes one at x = 0, the clamp both."""
    return 2 * (elements + 1) - (2 if clamped else 1)


_BEAMS: Final = {
    "steel": (Beam(207e9, 7800.0, 0.28, 0.019, 0.00635, 37), False, 1.5e7, 20.0),
    "aluminium": (Beam(70e9, 2700.0, 0.28, 0.019, 0.00318, 37), True, 9.6e6, 7.0),
}


def nominal(
    beam: Annotated[Literal["steel", "aluminium"], Key()] = "steel",
    modes: Annotated[int, Whole(1, 400)] = 15,
    elements: Annotated[int, Whole(2, 200)] = 37,
    modal_damping: Annotated[float, Quantity("", 0, 0.5)] = 0.01,
    base: Annotated[Literal["rigid", "flexible"], Key()] = "rigid",
    cover: Annotated[Literal["none", "aluminium", "fibreglass"], Key()] = "none",
    flexure_translation: Annotated[bool, Key()] = False,
    flexure_length: Annotated[float | None, Quantity("mm", 0.1, 100, usual=4), _TABLE_1] = None,
    flexure_width: Annotated[float | None, Quantity("mm", 0.1, 1000, usual=19), _TABLE_1] = None,
    flexure_thickness: Annotated[float | None, Quantity("mm", 0.001, 10, usual=0.127), _TABLE_1] = None,
    mode_damping: Annotated[tuple[float, ...], Quantity("", 0, 0.5), _LOWEST_MODES] = (),
) -> ImpactBeam:
    """Return the rig of the source with its steel or aluminium beam (Table 2).

    A flexure of other dimensions (m) is stiffer in turning as w t^3 / l, in translation as w t^3 / l^3.
    `mode_damping` are the ratios of the lowest modes, one by one; all above have `modal_damping`.
    """
    part, clamped, stiffness, contact_damping = _BEAMS[beam]
    longer, wider, thicker = (
        1.0 if given is None else given / own
        for given, own in zip((flexure_length, flexure_width, flexure_thickness), _FLEXURE, strict=True)
    )
    return ImpactBeam(
        replace(part, elements=elements),
        clamped,
        stiffness,
        contact_damping,
        (*mode_damping, *(modal_damping,) * (modes - len(mode_damping))),
        rotation_stiffness=FLEXURE_ROTATION * (wider * thicker**3 / longer),
        pivot_stiffness=FLEXURE_TRANSLATION * (wider * thicker**3 / longer**3)
        if flexure_translation
        else None,
        base=flexible_base(cover) if base == "flexible" else None,
    )


def _no_clamp(key: str, model: Mapping[str, Any]) -> bool:
    return model["beam"] != "aluminium" or not model[key]


def _most_modes(model: Mapping[str, Any]) -> int:
    return freedoms(model["elements"], model["beam"] == "aluminium")


CHECKS: Final = (
    rule(
        ("beam", "modes", "elements"),
        lambda model: model["modes"] <= _most_modes(model),
        ("modes", "elements"),
        lambda model: (
            f"no more modes than the mesh has: {_most_modes(model)} for {model['elements']} elements, "
            f"{model['modes']} asked for"
        ),
    ),
    rule(
        ("clearance", "rest_offset"),
        lambda model: abs(model["rest_offset"]) < model["clearance"] or not model["rest_offset"],
        "rest_offset",
        lambda model: f"less than the clearance, {model['clearance'] * 1e3:g} mm, to either side",
    ),
    rule(
        ("base", "cover"),
        lambda model: model["cover"] == "none" or model["base"] == "flexible",
        "cover",
        '"none", or with base = "flexible", which is what a cover acts on',
    ),
    *(
        rule(
            ("beam", key),
            partial(_no_clamp, key),
            key,
            f"{none} (the aluminium beam is clamped)",
        )
        for key, none in (
            ("flexure_translation", "false"),
            *((f"flexure_{of}", "none") for of in ("length", "width", "thickness")),
        )
    ),
    rule(
        ("modes", "mode_damping"),
        lambda model: len(model["mode_damping"]) <= model["modes"],
        "mode_damping",
        lambda model: f"as many at most as modes are kept, {model['modes']}",
    ),
    *part_checks(ImpactBeam, "base_", "base", "rigid"),
    *part_checks(ImpactBeam, "base_cover_", "cover", "none"),
)
"""Of what may be asked for together."""
_LARGEST_FORCE_N: Final = 100.0


def _peak_n(drive: Mapping[str, Any]) -> float:
    return float(drive["amplitude"] + abs(drive["offset"]))


@dataclass(frozen=True, slots=True)
class SineDrive:
    """The coil's force: offset + A (sin p + second sin 2p + third sin 3p), p = 2 pi f t + phase.

    `amplitude` A and `offset` in N, `frequency` f in Hz; `second`, `third` are fractions of A.
    """

    amplitude: Annotated[
        float,
        Quantity("N", 0, _LARGEST_FORCE_N, default=9.0, means="peak of the sine, not peak to peak, not rms"),
        Source(f"{_PAPER}, section 3D"),
        Bound("", -1e6, 1e6),
    ]
    frequency: Annotated[float, Quantity("Hz", 0.1, 2000, usual=20), Bound("Hz", 0.0, above=True)]
    offset: Annotated[float, Quantity("N", -_LARGEST_FORCE_N, _LARGEST_FORCE_N), Bound("", -1e6, 1e6)] = 0.0
    second: Annotated[float, Bound("", -1e6, 1e6)] = 0.0
    third: Annotated[float, Bound("", -1e6, 1e6)] = 0.0
    CHECKS: ClassVar = (
        rule(
            ("amplitude", "offset"),
            lambda drive: _peak_n(drive) <= _LARGEST_FORCE_N,
            "offset",
            lambda drive: (
                f"amplitude and offset together up to {_LARGEST_FORCE_N:g} N, not {_peak_n(drive):g} N"
            ),
        ),
    )

    def __post_init__(self) -> None:
        require_bounds("SineDrive", self)

    @property
    def cycle_hz(self) -> float:
        return self.frequency

    @property
    def peak(self) -> float:
        """Largest absolute force in N."""
        return self.amplitude + abs(self.offset)

    def at_cycle_hz(self, cycle_hz: float) -> SineDrive:
        return replace(self, frequency=cycle_hz)

    def phase_after(self, phase: float, cycle_hz: float, time: float) -> float:
        """Phase in rad at `time` s since sample 0, which is at `phase`; `cycle_hz` is its own frequency."""
        return phase + 2 * pi * self.frequency * time

    def phasors(self) -> NDArray[np.complex128]:
        """Complex amplitudes of orders 0, 1, 2, 3, shape (4,): the force is the sum of Re(U_k exp(i k p))."""
        A = self.amplitude
        return np.array([self.offset, -1j * A, -1j * A * self.second, -1j * A * self.third])

    def force(self, phase: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force in N at phases p (rad), same shape."""
        second, third = self.second * np.sin(2 * phase), self.third * np.sin(3 * phase)
        return np.asarray(self.offset + self.amplitude * (np.sin(phase) + second + third))
