"""Effects of the planar slider-crank: joints, guide, rod, drive, piston and frame."""

from __future__ import annotations

from sim_twin.effects import (
    Effect,
    Parameter,
    ParameterValues,
    PutIn,
    analog_delay,
    catalogue_of,
    scaled,
    sensor_bandwidth,
    sensor_factor,
    sensor_gain,
    set_to,
    swapped_channels,
    time_skew,
)
from sim_twin.rigs.crank_drive import speed_fluctuation
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS, MARKER
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank, RodBending
from sim_twin.twin import AnyTwin, changed


def _frame(twin: AnyTwin, values: ParameterValues) -> AnyTwin:
    place, scale = ("rig", "frames", str(values["channel"]), "frequency"), float(values["frequency_scale"])
    affected: AnyTwin = changed(twin, {place: lambda frequency: frequency * scale})
    return affected


_ANY_PHASE = 6.283185307179587
"""A last bit above 2 pi: seeded draws hang on it."""
_CLEARANCE = ((0.3, 0.8), (1.25, 2.5))

EFFECTS = catalogue_of(
    PlanarSliderCrank.kind,
    (
        scaled("joint1_clearance", "joint 1", _CLEARANCE, "rig.clearance_1"),
        scaled("joint2_clearance", "joint 2", _CLEARANCE, "rig.clearance_2"),
        scaled("contact_stiffness", "joints", ((0.2, 0.7), (1.4, 5.0)), "rig.stiffness_scales"),
        set_to("restitution", "joints", {"rig.restitution": Parameter("value", "", ((0.3, 0.8),))}),
        set_to("joint_friction", "joints", {"rig.friction": Parameter("coefficient", "", ((0.04, 0.3),))}),
        set_to(
            "guide_friction", "guide", {"rig.guide_friction": Parameter("coefficient", "", ((0.1, 0.5),))}
        ),
        Effect(
            "rod_flexibility",
            "rod",
            (
                Parameter("frequency_hz", "Hz", ((60.0, 500.0),)),
                Parameter("damping_ratio", "", ((0.003, 0.05),)),
            ),
            PutIn("bending", RodBending, ("frequency_hz", "damping_ratio")),
            refusal=lambda twin: "" if twin.rig.bending is None else "the rod bends already",
        ),
        speed_fluctuation(_ANY_PHASE),
        scaled("piston_mass", "piston", ((0.5, 0.85), (1.2, 2.0)), "rig.piston_mass"),
        Effect(
            "frame_resonance",
            "frame",
            (Parameter("frequency_scale", "", ((0.6, 0.9), (1.1, 1.6))),),
            _frame,
            ACCELERATIONS,
        ),
        sensor_gain(ACCELERATIONS),
        sensor_factor(ACCELERATIONS),
        swapped_channels(ACCELERATIONS),
        sensor_bandwidth(ACCELERATIONS),
        time_skew((*ACCELERATIONS, MARKER)),
        analog_delay(),
    ),
)
