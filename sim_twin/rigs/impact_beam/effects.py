"""Effects of the impact beam: contact joint, base, pivot, beam and drive."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from sim_twin.effects.effect import Effect, Parameter, ParameterValues, catalogue_of
from sim_twin.effects.sensing import sensor_bandwidth, sensor_droop, sensor_gain, time_skew
from sim_twin.rigs.impact_beam.base.model import FlexibleBase
from sim_twin.rigs.impact_beam.channels import COVER, DRIVE, LOWER, UPPER, YOKE
from sim_twin.rigs.impact_beam.model import BaseMass, ImpactBeam

if TYPE_CHECKING:
    from sim_twin.rigs.impact_beam.truth import BeamTwin

_LEAST_DISTORTION = 0.04
_FORCES = (UPPER.name, LOWER.name, YOKE.name)
_ACCELERATIONS = tuple(each.name for each in COVER)
_SENSED = (DRIVE.name, *_FORCES, *_ACCELERATIONS)


def _number(values: ParameterValues, name: str) -> float:
    return float(values[name])


def _scale(twin: BeamTwin, values: ParameterValues, attribute: str) -> BeamTwin:
    rig = twin.rig
    return _with_rig(twin, **{attribute: getattr(rig, attribute) * _number(values, "scale")})


def _set(twin: BeamTwin, values: ParameterValues, fields: tuple[tuple[str, str], ...]) -> BeamTwin:
    return _with_rig(twin, **{attribute: _number(values, name) for attribute, name in fields})


def _with_rig(twin: BeamTwin, **changes: object) -> BeamTwin:
    rig: ImpactBeam = replace(twin.rig, **changes)  # type: ignore[arg-type]
    return replace(twin, rig=rig)


def _stiffness(twin: BeamTwin, values: ParameterValues) -> BeamTwin:
    """Whichever law the contact has, linear or Hertz's."""
    scale, rig = _number(values, "scale"), twin.rig
    hertz = None if rig.hertz is None else scale * rig.hertz
    return _with_rig(twin, contact_stiffness=scale * rig.contact_stiffness, hertz=hertz)


def _base(twin: BeamTwin, values: ParameterValues) -> BeamTwin:
    base = BaseMass(
        _number(values, "frequency_hz"), _number(values, "mass_kg"), _number(values, "damping_ratio")
    )
    return _with_rig(twin, base=base)


def _damping(twin: BeamTwin, values: ParameterValues) -> BeamTwin:
    factor = _number(values, "scale")
    return _with_rig(twin, modal_damping=tuple(zeta * factor for zeta in twin.rig.modal_damping))


def _distortion(twin: BeamTwin, values: ParameterValues) -> BeamTwin:
    drive = replace(twin.drive, second=_number(values, "second"), third=_number(values, "third"))
    return replace(twin, drive=drive)


def _too_little(values: ParameterValues) -> str:
    largest = max(_number(values, "second"), _number(values, "third"))
    return f"second or third is at least {_LEAST_DISTORTION}" if largest < _LEAST_DISTORTION else ""


def _not_if_clamped(twin: BeamTwin) -> str:
    return "the beam is clamped" if twin.rig.clamped else ""


def _not_on_a_flexible_base(twin: BeamTwin) -> str:
    return "its base is flexible already" if isinstance(twin.rig.base, FlexibleBase) else ""


def _scale_of(name: str, location: str, attribute: str, *intervals: tuple[float, float]) -> Effect:
    return Effect(name, location, (Parameter("scale", "", intervals),), partial(_scale, attribute=attribute))


_EFFECTS = (
    _scale_of("clearance", "contact joint", "clearance", (0.5, 0.9), (1.1, 2.0)),
    Effect(
        "contact_stiffness",
        "contact joint",
        (Parameter("scale", "", ((0.2, 0.7), (1.4, 5.0))),),
        _stiffness,
    ),
    _scale_of("contact_damping", "contact joint", "contact_damping", (3.0, 20.0)),
    Effect(
        "hertzian_contact",
        "contact joint",
        (Parameter("stiffness_n_per_m15", "N/m^1.5", ((3e9, 3e10),)),),
        partial(_set, fields=(("hertz", "stiffness_n_per_m15"),)),
    ),
    Effect(
        "base_flexibility",
        "base",
        (
            Parameter("frequency_hz", "Hz", ((150.0, 1500.0),)),
            Parameter("mass_kg", "kg", ((0.5, 8.0),)),
            Parameter("damping_ratio", "", ((0.003, 0.05),)),
        ),
        _base,
        refusal=_not_on_a_flexible_base,
    ),
    Effect(
        "pivot_friction",
        "pivot",
        (Parameter("torque_nm", "N m", ((0.02, 0.3),)),),
        partial(_set, fields=(("pivot_friction", "torque_nm"),)),
        refusal=_not_if_clamped,
    ),
    Effect(
        "pivot_compliance",
        "pivot",
        (Parameter("stiffness_n_per_m", "N/m", ((1e5, 5e7),)),),
        partial(_set, fields=(("pivot_stiffness", "stiffness_n_per_m"),)),
        refusal=_not_if_clamped,
    ),
    Effect("structural_damping", "beam", (Parameter("scale", "", ((2.0, 8.0),)),), _damping),
    Effect(
        "shaker_mass",
        "drive",
        (Parameter("mass_kg", "kg", ((0.02, 0.3),)),),
        partial(_set, fields=(("shaker_mass", "mass_kg"),)),
    ),
    Effect(
        "shaker_suspension",
        "drive",
        (
            Parameter("stiffness_n_per_m", "N/m", ((1e3, 3e4),)),
            Parameter("damping_ns_per_m", "N s/m", ((2.0, 40.0),)),
        ),
        partial(
            _set,
            fields=(("shaker_stiffness", "stiffness_n_per_m"), ("shaker_damping", "damping_ns_per_m")),
        ),
    ),
    Effect(
        "drive_distortion",
        "drive",
        (Parameter("second", "", ((0.0, 0.2),)), Parameter("third", "", ((0.0, 0.2),))),
        _distortion,
        together=_too_little,
    ),
    sensor_gain(_SENSED),
    sensor_droop(_SENSED),
    sensor_bandwidth((*_FORCES, *_ACCELERATIONS)),
    time_skew(_SENSED),
)
EFFECTS = catalogue_of(ImpactBeam.kind, _EFFECTS)
