"""The planar slider-crank's twin from its scenario, in step with the measured crank angle."""

from __future__ import annotations

from dataclasses import replace

from rig.files.rigs.planar_slider_crank import PlanarSliderCrankSection
from rig.files.rigs.speed import SpeedSection
from rig.twin.crank_alignment import MARKED_TURNS, align_angle, align_marker, untouched
from rig.twin.rigs.kind import Reference, TwinKind, given
from rig.twin.rigs.turning import angle_at, in_step
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank, nominal
from sim_twin.rigs.planar_slider_crank.rig import MODEL
from sim_twin.twin import Twin


def _build(
    section: PlanarSliderCrankSection, drive: SpeedSection, channels: tuple[str, ...]
) -> Twin[PlanarSliderCrank, SpeedDrive]:
    changes = given(section)
    rig = replace(nominal(changes.pop("material", "steel")), **changes)
    speed = SpeedDrive(drive.speed)
    return Twin(rig, speed, MODEL.nominal_sensors(rig, speed))


KIND = TwinKind(
    model=MODEL,
    build=_build,
    references=(Reference("crank.angle", align_angle), Reference("crank.marker", align_marker, MARKED_TURNS)),
    in_step=in_step,
    phase_at=angle_at,
    untouched=untouched,
    variations=({"speed": 1.5}, {"speed": 0.6}, {"speed": 1.25}, {"speed": 0.8}),
)
