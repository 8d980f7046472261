"""Effects of the planar slider-crank: joints, guide, rod, drive, piston and frame."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from sim_twin.effects.effect import Effect, Parameter, ParameterValues, catalogue_of
from sim_twin.effects.sensing import sensor_bandwidth, sensor_gain, time_skew
from sim_twin.rigs.crank_drive import fluctuation_coordinates
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS, MARKER
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank, RodBending

if TYPE_CHECKING:
    from sim_twin.rigs.planar_slider_crank.truth import CrankTwin


def _scale(twin: CrankTwin, values: ParameterValues, attribute: str) -> CrankTwin:
    scaled = getattr(twin.rig, attribute) * float(values["scale"])
    return replace(twin, rig=replace(twin.rig, **{attribute: scaled}))


def _set(twin: CrankTwin, values: ParameterValues, attribute: str, parameter: str) -> CrankTwin:
    return replace(twin, rig=replace(twin.rig, **{attribute: float(values[parameter])}))  # type: ignore[arg-type]


def _stiffness(twin: CrankTwin, values: ParameterValues) -> CrankTwin:
    first, second = twin.rig.stiffness_scales
    scale = float(values["scale"])
    return replace(twin, rig=replace(twin.rig, stiffness_scales=(scale * first, scale * second)))


def _bending(twin: CrankTwin, values: ParameterValues) -> CrankTwin:
    bending = RodBending(float(values["frequency_hz"]), float(values["damping_ratio"]))
    return replace(twin, rig=replace(twin.rig, bending=bending))


def _fluctuation(twin: CrankTwin, values: ParameterValues) -> CrankTwin:
    amplitude, order, phase = (float(values[name]) for name in ("amplitude", "order", "phase_rad"))
    return replace(twin, drive=replace(twin.drive, fluctuation=amplitude, order=order, phase=phase))


def _frame(twin: CrankTwin, values: ParameterValues) -> CrankTwin:
    channel = str(values["channel"])
    mode = twin.rig.frames[channel]
    changed = replace(mode, frequency=mode.frequency * float(values["frequency_scale"]))
    return replace(twin, rig=replace(twin.rig, frames={**twin.rig.frames, channel: changed}))


def _one(name: str, unit: str, *intervals: tuple[float, float]) -> tuple[Parameter, ...]:
    return (Parameter(name, unit, intervals),)


_ANY_PHASE = (-6.283185307179587, 6.283185307179587)
_CLEARANCE = _one("scale", "", (0.3, 0.8), (1.25, 2.5))

EFFECTS = catalogue_of(
    PlanarSliderCrank.kind,
    (
        Effect("joint1_clearance", "joint 1", _CLEARANCE, partial(_scale, attribute="clearance_1")),
        Effect("joint2_clearance", "joint 2", _CLEARANCE, partial(_scale, attribute="clearance_2")),
        Effect("contact_stiffness", "joints", _one("scale", "", (0.2, 0.7), (1.4, 5.0)), _stiffness),
        Effect(
            "restitution",
            "joints",
            _one("value", "", (0.3, 0.8)),
            partial(_set, attribute="restitution", parameter="value"),
        ),
        Effect(
            "joint_friction",
            "joints",
            _one("coefficient", "", (0.04, 0.3)),
            partial(_set, attribute="friction", parameter="coefficient"),
        ),
        Effect(
            "guide_friction",
            "guide",
            _one("coefficient", "", (0.1, 0.5)),
            partial(_set, attribute="guide_friction", parameter="coefficient"),
        ),
        Effect(
            "rod_flexibility",
            "rod",
            (
                *_one("frequency_hz", "Hz", (60.0, 500.0)),
                *_one("damping_ratio", "", (0.003, 0.05)),
            ),
            _bending,
        ),
        Effect(
            "speed_fluctuation",
            "drive",
            (
                *_one("amplitude", "", (0.005, 0.05)),
                Parameter("order", "", ((1.0, 4.0),), whole=True),
                *_one("phase_rad", "rad", _ANY_PHASE),
            ),
            _fluctuation,
            coordinates=fluctuation_coordinates,
        ),
        Effect(
            "piston_mass",
            "piston",
            _one("scale", "", (0.5, 0.85), (1.2, 2.0)),
            partial(_scale, attribute="piston_mass"),
        ),
        Effect(
            "frame_resonance",
            "frame",
            _one("frequency_scale", "", (0.6, 0.9), (1.1, 1.6)),
            _frame,
            ACCELERATIONS,
        ),
        sensor_gain(ACCELERATIONS),
        sensor_bandwidth(ACCELERATIONS),
        time_skew((*ACCELERATIONS, MARKER)),
    ),
)
