"""Scenario sections and channels of the spatial slider-crank (physics.md section 3; source: the SSC)."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic.dataclasses import dataclass

from rig.crank.channels import SPATIAL_SLIDER_CRANK
from rig.files.benches.spatial_slider_crank import BENCH
from rig.files.fields import Measured, Whole
from rig.files.rigs.kind import RigKind, unit_or_none
from rig.files.rigs.speed import MAXIMUM_SPEED, SpeedSection, highest_speed, revolutions_per_second
from rig.files.section import SECTION
from sim_twin.rigs.spatial_slider_crank.channels import CHANNELS, channel_unit


@dataclass(frozen=True, slots=True, config=SECTION)
class SpatialSliderCrankSection:
    """What the operator believes the mechanism to be, in SI; None is the default.

    `axis_angle` lies between the crank's axis and the slider's. Clearances are half the free motion.
    """

    axis_angle: Annotated[float | None, Measured("deg", 65, 90)] = None
    socket_clearance: Annotated[float | None, Measured("mm", 0.001, 2)] = None
    guide_clearance: Annotated[float | None, Measured("mm", 0.001, 2)] = None
    friction: Annotated[float | None, Measured("", 0, 1)] = None
    slider_mass: Annotated[float | None, Measured("kg", 0.001, 10)] = None
    rod_modes: Annotated[int | None, Whole(0, 40)] = None
    gravity: Annotated[float | None, Measured("m/s^2", 0, 100)] = None


KIND: Final = RigKind(
    name="spatial_slider_crank",
    actuator="inverter",
    bench=BENCH,
    set_up=("axis_angle", "socket_clearance", "guide_clearance", "rod_modes"),
    model=SpatialSliderCrankSection,
    model_checks=(),
    drive=SpeedSection,
    drive_checks=(),
    channels=CHANNELS,
    channel_unit=unit_or_none(channel_unit),
    drive_frequency=revolutions_per_second,
    drive_peak=highest_speed,
    highest=MAXIMUM_SPEED,
    by_hand={
        "axis_angle": "turn the guide to that angle from the crank's axis",
        "socket_clearance": "set the ball joint's clearance (half of the free motion)",
        "guide_clearance": "set the guide's clearance (half of the free motion)",
    },
    contacts=tuple(f"slider.force_{number}" for number in range(1, 9)),
    extras=("encoder",),
    crank=SPATIAL_SLIDER_CRANK,
)
