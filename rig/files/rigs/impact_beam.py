"""Scenario sections and channels of the impact beam (physics.md section 1; Deck and Dubowsky's IBS)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Final, Literal

from pydantic.dataclasses import dataclass

from rig.files.benches.impact_beam import BENCH
from rig.files.fields import Measured, Switch, Whole, Word
from rig.files.rigs.kind import Highest, RigKind, ShownSine, unit_or_none
from rig.files.section import SECTION, Check
from sim_twin.rigs.impact_beam.channels import channel_names, channel_unit

DEFAULT_CLEARANCE_M: Final = 0.127e-3
DEFAULT_ELEMENTS: Final = 37
DEFAULT_MODES: Final = 15
_LARGEST_FORCE_N: Final = 100.0


@dataclass(frozen=True, slots=True, config=SECTION)
class ImpactBeamSection:
    """What the operator believes the beam to be, in SI; None where the scenario leaves it to the default.

    `drive_position` is a fraction of the beam's length from the pivot; `rest_offset` is positive towards the
    upper contact.
    """

    beam: Annotated[Literal["steel", "aluminium"] | None, Word(("steel", "aluminium"))] = None
    base: Annotated[Literal["rigid", "flexible"] | None, Word(("rigid", "flexible"))] = None
    cover: Annotated[
        Literal["none", "aluminium", "fibreglass"] | None, Word(("none", "aluminium", "fibreglass"))
    ] = None
    clearance: Annotated[float | None, Measured("mm", 0.001, 10)] = None
    rest_offset: Annotated[float | None, Measured("mm", -10, 10)] = None
    modal_damping: Annotated[float | None, Measured("", 0, 0.5)] = None
    modes: Annotated[int | None, Whole(1, 400)] = None
    elements: Annotated[int | None, Whole(2, 200)] = None
    contact_stiffness: Annotated[float | None, Measured("N/m", 1e3, 1e10)] = None
    contact_damping: Annotated[float | None, Measured("N s/m", 0, 1e5)] = None
    drive_position: Annotated[float | None, Measured("", 0.01, 1)] = None
    shaker_mass: Annotated[float | None, Measured("kg", 0, 10)] = None
    shaker_stiffness: Annotated[float | None, Measured("N/m", 0, 1e7)] = None
    shaker_damping: Annotated[float | None, Measured("N s/m", 0, 1e4)] = None
    flexure_translation: Annotated[bool | None, Switch()] = None


@dataclass(frozen=True, slots=True, config=SECTION)
class DriveSection:
    """The shaker's sine: frequency in Hz, amplitude and offset of the force in N."""

    frequency: Annotated[float, Measured("Hz", 0.1, 2000)]
    amplitude: Annotated[float, Measured("N", 0, _LARGEST_FORCE_N)] = 9.0
    offset: Annotated[float, Measured("N", -_LARGEST_FORCE_N, _LARGEST_FORCE_N)] = 0.0


def drive_peak(drive: DriveSection) -> float:
    """Largest absolute force of the drive in N."""
    return drive.amplitude + abs(drive.offset)


def sine_hertz(drive: DriveSection) -> float | None:
    """Frequency of the sine; None for a drive without an amplitude."""
    return drive.frequency if drive.amplitude else None


def _mesh_has_modes(model: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    elements = model["elements"] or DEFAULT_ELEMENTS
    modes = model["modes"] or DEFAULT_MODES
    # two degrees of freedom a node; the pin takes one at x = 0, the clamp both
    freedoms = 2 * (elements + 1) - (2 if model["beam"] == "aluminium" else 1)
    if modes > freedoms:
        key = "modes" if model["modes"] else "elements"
        yield key, f"no more modes than the mesh has: {freedoms} for {elements} elements, {modes} asked for"


def _rests_inside(model: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    clearance = DEFAULT_CLEARANCE_M if model["clearance"] is None else model["clearance"]
    offset = model["rest_offset"]
    if offset is not None and abs(offset) >= clearance:
        yield "rest_offset", f"less than the clearance, {clearance * 1e3:g} mm, to either side"


def _covers_a_base(model: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if model["cover"] not in (None, "none") and model["base"] != "flexible":
        yield "cover", '"none", or with base = "flexible", which is what a cover acts on'


def _clamp_does_not_move(model: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if model["beam"] == "aluminium" and model["flexure_translation"]:
        yield "flexure_translation", "false (the aluminium beam is clamped)"


def _peak_in_range(drive: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    peak = drive["amplitude"] + abs(drive["offset"])
    if peak > _LARGEST_FORCE_N:
        yield "offset", f"amplitude and offset together up to {_LARGEST_FORCE_N:g} N, not {peak:g} N"


KIND: Final = RigKind(
    name="impact_beam",
    actuator="signal_generator",
    bench=BENCH,
    set_up=("clearance", "rest_offset", "drive_position", "cover", "modes", "elements"),
    model=ImpactBeamSection,
    model_checks=(
        Check(("beam", "modes", "elements"), _mesh_has_modes),
        Check(("clearance", "rest_offset"), _rests_inside),
        Check(("base", "cover"), _covers_a_base),
        Check(("beam", "flexure_translation"), _clamp_does_not_move),
    ),
    drive=DriveSection,
    drive_checks=(Check(("amplitude", "offset"), _peak_in_range),),
    channels=(*channel_names((), covered=True), "beam.acceleration_NN (NN: 01 to 100, % of the length)"),
    channel_unit=unit_or_none(channel_unit),
    drive_frequency=lambda drive: drive.get("frequency"),
    drive_peak=drive_peak,
    highest=Highest("maximum_amplitude", "N", lambda generator: generator.maximum_amplitude),
    by_hand={
        "clearance": "move the two stops: the clearance is half of the tip's free motion",
        "rest_offset": "shift the yoke, so that the tip rests that far from the middle",
        "drive_position": "clamp the shaker's rod there (fraction of the length from the pivot)",
        "beam": "mount that beam",
        "base": "mount the yoke on that base",
        "cover": "mount that cover, or take it off",
    },
    contacts=("contact.force_upper", "contact.force_lower"),
    sine=ShownSine("drive.force", sine_hertz),
)
