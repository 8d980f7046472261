"""The spatial slider-crank's twin from its scenario, in step with the flywheel's marker."""

from __future__ import annotations

from dataclasses import replace

from rig.files.rigs.spatial_slider_crank import SpatialSliderCrankSection
from rig.files.rigs.speed import SpeedSection
from rig.twin.crank_alignment import MARKED_TURNS, align_marker, untouched
from rig.twin.rigs.kind import Reference, TwinKind, given
from rig.twin.rigs.turning import angle_at, in_step
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.model import Slider, SpatialSliderCrank
from sim_twin.rigs.spatial_slider_crank.rig import MODEL
from sim_twin.twin import Twin


def _build(
    section: SpatialSliderCrankSection, drive: SpeedSection, channels: tuple[str, ...]
) -> Twin[SpatialSliderCrank, SpeedDrive]:
    changes = given(section)
    rig = SpatialSliderCrank()
    if "slider_mass" in changes:
        rig = replace(rig, slider=_slider(rig.slider, changes.pop("slider_mass")))
    rig = replace(rig, **changes)
    speed = SpeedDrive(drive.speed)
    return Twin(rig, speed, MODEL.nominal_sensors(rig, speed))


def _slider(slider: Slider, mass: float) -> Slider:
    """The same block of another material: its inertia goes with its mass."""
    first, second, third = (moment * mass / slider.mass for moment in slider.inertia)
    return replace(slider, mass=mass, inertia=(first, second, third))


KIND = TwinKind(
    model=MODEL,
    build=_build,
    references=(Reference("flywheel.marker", align_marker, MARKED_TURNS),),
    in_step=in_step,
    phase_at=angle_at,
    untouched=untouched,
    variations=({"speed": 1.3}, {"speed": 0.6}),
)
