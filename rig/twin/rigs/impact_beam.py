"""The impact beam's twin from its scenario, in step with the measured drive force."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import TYPE_CHECKING, Any

from rig.files.rigs.impact_beam import DriveSection, ImpactBeamSection
from rig.twin.alignment import Alignment, align
from rig.twin.rigs.kind import Reference, TwinKind
from sim_twin.rigs.impact_beam.base.model import flexible_base
from sim_twin.rigs.impact_beam.channels import stations_of
from sim_twin.rigs.impact_beam.model import FLEXURE_TRANSLATION, ImpactBeam, SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.twin import Twin

_TAKEN_AS_THEY_ARE = (
    "clearance",
    "rest_offset",
    "contact_stiffness",
    "contact_damping",
    "drive_position",
    "shaker_mass",
    "shaker_stiffness",
    "shaker_damping",
)

if TYPE_CHECKING:
    from sim_twin.rigs.impact_beam.truth import BeamTwin


def _build(section: ImpactBeamSection, drive: DriveSection, channels: tuple[str, ...]) -> BeamTwin:
    """The nominal twin, with an accelerometer for each station among `channels`."""
    given = {name: getattr(section, name) for name in _TAKEN_AS_THEY_ARE}
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if section.base == "flexible":
        changes["base"] = flexible_base(section.cover or "none")
    if section.flexure_translation:
        changes["pivot_stiffness"] = FLEXURE_TRANSLATION
    rig: ImpactBeam = replace(_beam(section), stations=stations_of(channels), **changes)
    sine = SineDrive(drive.amplitude, drive.frequency, drive.offset)
    return Twin(rig, sine, MODEL.nominal_sensors(rig, sine))


def _beam(section: ImpactBeamSection) -> ImpactBeam:
    choices: dict[str, Any] = {
        "beam": section.beam,
        "modes": section.modes,
        "elements": section.elements,
        "damping": section.modal_damping,
    }
    return nominal(**{name: value for name, value in choices.items() if value is not None})


def _in_step(drive: SineDrive, alignment: Alignment) -> SineDrive:
    return replace(drive, frequency=alignment.frequency)


def _phase_at(drive: SineDrive, alignment: Alignment, time: float) -> float:
    return alignment.phase + 2 * pi * drive.frequency * time


def _untouched(drive: SineDrive) -> Alignment:
    return Alignment(drive.frequency, 0.0, trusted=False)


KIND = TwinKind(
    model=MODEL,
    build=_build,
    references=(Reference("drive.force", align),),
    in_step=_in_step,
    phase_at=_phase_at,
    untouched=_untouched,
    variations=(
        {"frequency": 2.0},
        {"frequency": 0.5},
        {"clearance": 2.0},
        {"amplitude": 1.3},
        {"clearance": 0.5},
    ),
)
