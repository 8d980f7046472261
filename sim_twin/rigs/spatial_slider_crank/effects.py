"""Effects of the spatial slider-crank: base, joints, rod and drive."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import pi
from typing import TYPE_CHECKING

from sim_twin.effects.effect import Effect, Parameter, ParameterValues, catalogue_of
from sim_twin.effects.sensing import sensor_bandwidth, sensor_droop, sensor_gain, time_skew
from sim_twin.rigs.crank_drive import fluctuation_coordinates
from sim_twin.rigs.spatial_slider_crank.channels import FORCES, MARKER
from sim_twin.rigs.spatial_slider_crank.model import BaseMass, SpatialSliderCrank

if TYPE_CHECKING:
    from sim_twin.rigs.spatial_slider_crank.truth import SpatialTwin


def _scale(twin: SpatialTwin, values: ParameterValues, attributes: tuple[str, ...]) -> SpatialTwin:
    scale = float(values["scale"])
    return _with_rig(twin, **{name: getattr(twin.rig, name) * scale for name in attributes})


def _with_rig(twin: SpatialTwin, **changes: object) -> SpatialTwin:
    return replace(twin, rig=replace(twin.rig, **changes))  # type: ignore[arg-type]


def _base(twin: SpatialTwin, values: ParameterValues) -> SpatialTwin:
    numbers = (float(values[name]) for name in ("frequency_hz", "mass_kg", "damping_ratio"))
    return _with_rig(twin, base=BaseMass(*numbers))


def _friction(twin: SpatialTwin, values: ParameterValues) -> SpatialTwin:
    return _with_rig(twin, friction=float(values["coefficient"]))


def _rod(twin: SpatialTwin, values: ParameterValues) -> SpatialTwin:
    rod = twin.rig.rod
    return _with_rig(twin, rod=replace(rod, E=rod.E * float(values["scale"])))


def _fluctuation(twin: SpatialTwin, values: ParameterValues) -> SpatialTwin:
    amplitude, order, phase = (float(values[name]) for name in ("amplitude", "order", "phase_rad"))
    return replace(twin, drive=replace(twin.drive, fluctuation=amplitude, order=order, phase=phase))


def _not_if_rigid(twin: SpatialTwin) -> str:
    return "" if twin.rig.bending_modes else "the rod is rigid"


def _one(name: str, unit: str, *intervals: tuple[float, float]) -> tuple[Parameter, ...]:
    return (Parameter(name, unit, intervals),)


def _scale_of(name: str, location: str, intervals: tuple[Parameter, ...], *attributes: str) -> Effect:
    return Effect(name, location, intervals, partial(_scale, attributes=attributes))


_CLEARANCE = _one("scale", "", (0.3, 0.8), (1.25, 2.5))
_STIFFNESS = _one("scale", "", (0.2, 0.7), (1.4, 5.0))
_DAMPING = _one("scale", "", (3.0, 20.0))

EFFECTS = catalogue_of(
    SpatialSliderCrank.kind,
    (
        Effect(
            "base_flexibility",
            "base",
            (
                *_one("frequency_hz", "Hz", (150.0, 1500.0)),
                *_one("mass_kg", "kg", (0.5, 8.0)),
                *_one("damping_ratio", "", (0.003, 0.05)),
            ),
            _base,
        ),
        _scale_of("socket_clearance", "socket", _CLEARANCE, "socket_clearance"),
        _scale_of("guide_clearance", "guide", _CLEARANCE, "guide_clearance"),
        Effect("guide_friction", "guide", _one("coefficient", "", (0.0, 0.05), (0.16, 0.3)), _friction),
        _scale_of("contact_stiffness", "joints", _STIFFNESS, "socket_stiffness", "guide_stiffness"),
        _scale_of("contact_damping", "joints", _DAMPING, "socket_damping", "guide_damping"),
        Effect(
            "rod_stiffness", "rod", _one("scale", "", (0.4, 0.8), (1.25, 2.5)), _rod, refusal=_not_if_rigid
        ),
        Effect(
            "speed_fluctuation",
            "drive",
            (
                *_one("amplitude", "", (0.005, 0.05)),
                Parameter("order", "", ((1.0, 4.0),), whole=True),
                *_one("phase_rad", "rad", (-2 * pi, 2 * pi)),
            ),
            _fluctuation,
            coordinates=fluctuation_coordinates,
        ),
        sensor_gain(FORCES),
        sensor_droop(FORCES),
        sensor_bandwidth(FORCES),
        time_skew((*FORCES, MARKER)),
    ),
)
