"""What each effect of the catalogue changes in the truth's rig; sensors and clocks are `sensing`'s."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

from benchmarks.blind.beam.rig import Rig, Stop, Tone, Yoke

Values: TypeAlias = Mapping[str, Any]
Change: TypeAlias = Callable[[Rig, Values], Rig]


def both(rig: Rig, change: Callable[[Stop], Stop]) -> Rig:
    """`rig` with both stops changed alike."""
    return replace(rig, upper=change(rig.upper), lower=change(rig.lower))


def _clearance(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, gap=stop.gap * values["scale"]))


def _stiffness(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, stiffness=stop.stiffness * values["scale"]))


def _damping(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, damping=stop.damping * values["scale"]))


def _hertz(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, stiffness=values["stiffness_n_per_m15"], exponent=1.5))


def _base(rig: Rig, values: Values) -> Rig:
    return replace(rig, yoke=Yoke(values["mass_kg"], values["frequency_hz"], values["damping_ratio"]))


def _friction(rig: Rig, values: Values) -> Rig:
    _require_pivot(rig)
    return replace(rig, pivot_torque=values["torque_nm"])


def _pivot(rig: Rig, values: Values) -> Rig:
    _require_pivot(rig)
    return replace(rig, beam=replace(rig.beam, pivot_stiffness=values["stiffness_n_per_m"]))


def _require_pivot(rig: Rig) -> None:
    if rig.beam.clamped:
        raise ValueError("the clamped beam has no pivot")


def _structure(rig: Rig, values: Values) -> Rig:
    ratios = tuple(ratio * values["scale"] for ratio in rig.beam.damping)
    return replace(rig, beam=replace(rig.beam, damping=ratios))


def _shaker_mass(rig: Rig, values: Values) -> Rig:
    return replace(rig, beam=replace(rig.beam, shaker_mass=values["mass_kg"]))


def _suspension(rig: Rig, values: Values) -> Rig:
    stiffness, damping = values["stiffness_n_per_m"], values["damping_ns_per_m"]
    return replace(rig, beam=replace(rig.beam, shaker_stiffness=stiffness, shaker_damping=damping))


def _distortion(rig: Rig, values: Values) -> Rig:
    first = rig.tones[0]
    harmonics = tuple(
        Tone(first.amplitude * values[name], first.frequency * order, first.phase * order)
        for order, name in ((2, "second"), (3, "third"))
    )
    return replace(rig, tones=rig.tones + harmonics)


CHANGES: Mapping[str, Change] = {
    "clearance": _clearance,
    "contact_stiffness": _stiffness,
    "contact_damping": _damping,
    "hertzian_contact": _hertz,
    "base_flexibility": _base,
    "pivot_friction": _friction,
    "pivot_compliance": _pivot,
    "structural_damping": _structure,
    "shaker_mass": _shaker_mass,
    "shaker_suspension": _suspension,
    "drive_distortion": _distortion,
}
SENSOR_EFFECTS = ("sensor_gain", "sensor_droop", "sensor_bandwidth", "time_skew")
