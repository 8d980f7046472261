"""Effects of the spatial slider-crank: base, joints, rod and drive."""

from __future__ import annotations

from dataclasses import replace

from sim_twin.effects import (
    Parameter,
    analog_delay,
    base_flexibility,
    catalogue_of,
    scaled,
    sensor_bandwidth,
    sensor_droop,
    sensor_factor,
    sensor_gain,
    set_to,
    swapped_channels,
    time_skew,
)
from sim_twin.rigs.crank_drive import speed_fluctuation
from sim_twin.rigs.spatial_slider_crank.channels import FORCES, MARKER
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank

_CLEARANCE, _STIFFNESS, _DAMPING = ((0.3, 0.8), (1.25, 2.5)), ((0.2, 0.7), (1.4, 5.0)), ((3.0, 20.0),)

EFFECTS = catalogue_of(
    SpatialSliderCrank.kind,
    (
        base_flexibility(),
        scaled("socket_clearance", "socket", _CLEARANCE, "rig.socket_clearance"),
        scaled("guide_clearance", "guide", _CLEARANCE, "rig.guide_clearance"),
        set_to(
            "guide_friction",
            "guide",
            {"rig.friction": Parameter("coefficient", "", ((0.0, 0.05), (0.16, 0.3)))},
        ),
        scaled("contact_stiffness", "joints", _STIFFNESS, "rig.socket_stiffness", "rig.guide_stiffness"),
        scaled("contact_damping", "joints", _DAMPING, "rig.socket_damping", "rig.guide_damping"),
        replace(
            scaled("rod_stiffness", "rod", ((0.4, 0.8), (1.25, 2.5)), "rig.rod.E"),
            refusal=lambda twin: "" if twin.rig.bending_modes else "the rod is rigid",
        ),
        speed_fluctuation(),
        sensor_gain(FORCES),
        sensor_factor(FORCES),
        swapped_channels(FORCES),
        sensor_droop(FORCES),
        sensor_bandwidth(FORCES),
        time_skew((*FORCES, MARKER)),
        analog_delay(),
    ),
)
