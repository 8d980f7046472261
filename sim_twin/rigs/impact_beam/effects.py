"""Effects of the impact beam: contact joint, base, pivot, beam and drive."""

from __future__ import annotations

from dataclasses import replace

from sim_twin.effects import (
    Effect,
    Parameter,
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
from sim_twin.rigs.impact_beam.channels import COVER, DRIVE, LOWER, UPPER, YOKE
from sim_twin.rigs.impact_beam.model import ImpactBeam

_LEAST_DISTORTION = 0.04
_FORCES = (UPPER.name, LOWER.name, YOKE.name)
_ACCELERATIONS = tuple(each.name for each in COVER)
_SENSED = (DRIVE.name, *_FORCES, *_ACCELERATIONS)


def _of_a_pin(name: str, place: str, parameter: Parameter) -> Effect:
    return replace(
        set_to(name, "pivot", {place: parameter}),
        refusal=lambda twin: "the beam is clamped" if twin.rig.clamped else "",
    )


EFFECTS = catalogue_of(
    ImpactBeam.kind,
    (
        scaled("clearance", "contact joint", ((0.5, 0.9), (1.1, 2.0)), "rig.clearance"),
        # whichever law the contact has, linear or Hertz's
        scaled(
            "contact_stiffness",
            "contact joint",
            ((0.2, 0.7), (1.4, 5.0)),
            "rig.contact_stiffness",
            "rig.hertz",
        ),
        scaled("contact_damping", "contact joint", ((3.0, 20.0),), "rig.contact_damping"),
        set_to(
            "hertzian_contact",
            "contact joint",
            {"rig.hertz": Parameter("stiffness_n_per_m15", "N/m^1.5", ((3e9, 3e10),))},
        ),
        base_flexibility(),
        _of_a_pin("pivot_friction", "rig.pivot_friction", Parameter("torque_nm", "N m", ((0.02, 0.3),))),
        _of_a_pin(
            "pivot_compliance",
            "rig.pivot_stiffness",
            Parameter("stiffness_n_per_m", "N/m", ((1e5, 5e7),)),
        ),
        scaled("structural_damping", "beam", ((2.0, 8.0),), "rig.modal_damping"),
        set_to("shaker_mass", "drive", {"rig.shaker_mass": Parameter("mass_kg", "kg", ((0.02, 0.3),))}),
        set_to(
            "shaker_suspension",
            "drive",
            {
                "rig.shaker_stiffness": Parameter("stiffness_n_per_m", "N/m", ((1e3, 3e4),)),
                "rig.shaker_damping": Parameter("damping_ns_per_m", "N s/m", ((2.0, 40.0),)),
            },
        ),
        replace(
            set_to(
                "drive_distortion",
                "drive",
                {f"drive.{order}": Parameter(order, "", ((0.0, 0.2),)) for order in ("second", "third")},
            ),
            together=lambda values: (
                f"second or third is at least {_LEAST_DISTORTION}"
                if max(float(values["second"]), float(values["third"])) < _LEAST_DISTORTION
                else ""
            ),
        ),
        sensor_gain(_SENSED),
        sensor_factor(_SENSED),
        swapped_channels(_FORCES),
        sensor_droop(_SENSED),
        sensor_bandwidth((*_FORCES, *_ACCELERATIONS)),
        time_skew(_SENSED),
    ),
)
