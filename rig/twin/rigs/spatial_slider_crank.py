"""The spatial slider-crank's twin from its scenario, in step with the flywheel's marker."""

from __future__ import annotations

from dataclasses import replace
from math import pi

from rig.files.rigs.spatial_slider_crank import SpatialSliderCrankSection
from rig.files.rigs.speed import SpeedSection
from rig.twin.alignment import Alignment
from rig.twin.crank_alignment import align_marker, untouched
from rig.twin.rigs.kind import TwinKind, given
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank, SpeedDrive
from sim_twin.rigs.spatial_slider_crank.rig import MODEL
from sim_twin.twin import Twin


def _build(
    section: SpatialSliderCrankSection, drive: SpeedSection, channels: tuple[str, ...]
) -> Twin[SpatialSliderCrank, SpeedDrive]:
    changes = given(section)
    rig = SpatialSliderCrank()
    if "slider_mass" in changes:
        rig = replace(rig, slider=replace(rig.slider, mass=changes.pop("slider_mass")))
    rig = replace(rig, **changes)
    speed = SpeedDrive(drive.speed)
    return Twin(rig, speed, MODEL.nominal_sensors(rig, speed))


def _in_step(drive: SpeedDrive, alignment: Alignment) -> SpeedDrive:
    return replace(drive, speed=2 * pi * alignment.frequency)


KIND = TwinKind(
    model=MODEL,
    build=_build,
    reference="flywheel.marker",
    align=align_marker,
    in_step=_in_step,
    untouched=untouched,
)
