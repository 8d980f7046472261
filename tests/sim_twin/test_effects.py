"""The catalogue of effects: each changes what the physics says, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from sim_twin.effects import BaseMass, Effect, ParameterValues
from sim_twin.rigs.impact_beam.base.model import flexible_base
from sim_twin.rigs.impact_beam.effects import EFFECTS as IMPACT_BEAM
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.sensors import SensorChain
from sim_twin.twin import Twin

apply_effects = MODEL.with_effects
TWIN = Twin(nominal(), SineDrive(9.0, 20.0))
SAMPLE_RATE = 51_200.0
_UPPER = "contact.force_upper"

# Values within the range, and every field of the twin that they change, with its new value.
CHANGES: Mapping[str, tuple[ParameterValues, dict[str, object]]] = {
    "clearance": ({"scale": 1.5}, {"rig.clearance": 1.5 * 0.127e-3}),
    "contact_stiffness": ({"scale": 0.5}, {"rig.contact_stiffness": 0.75e7}),
    "contact_damping": ({"scale": 10.0}, {"rig.contact_damping": 200.0}),
    "hertzian_contact": ({"stiffness_n_per_m15": 1e10}, {"rig.hertz": 1e10}),
    "base_flexibility": (
        {"frequency_hz": 400.0, "mass_kg": 2.0, "damping_ratio": 0.01},
        {"rig.base": BaseMass(400.0, 2.0, 0.01)},
    ),
    "pivot_friction": ({"torque_nm": 0.1}, {"rig.pivot_friction": 0.1}),
    "pivot_compliance": ({"stiffness_n_per_m": 1e6}, {"rig.pivot_stiffness": 1e6}),
    "structural_damping": ({"scale": 4.0}, {"rig.modal_damping": (0.04,) * 15}),
    "shaker_mass": ({"mass_kg": 0.1}, {"rig.shaker_mass": 0.1}),
    "shaker_suspension": (
        {"stiffness_n_per_m": 3e3, "damping_ns_per_m": 20.0},
        {"rig.shaker_stiffness": 3e3, "rig.shaker_damping": 20.0},
    ),
    "drive_distortion": ({"second": 0.1, "third": 0.0}, {"drive.second": 0.1}),
    "sensor_gain": ({"channel": _UPPER, "gain": 0.8}, {"sensors": {_UPPER: SensorChain(gain=0.8)}}),
    "sensor_factor": ({"channel": _UPPER, "factor": -1.0}, {"sensors": {_UPPER: SensorChain(factor=-1.0)}}),
    "swapped_channels": (
        {"channel": _UPPER, "other": 2.0},
        {"sensors": {_UPPER: SensorChain(source="yoke.force"), "yoke.force": SensorChain(source=_UPPER)}},
    ),
    "sensor_droop": (
        {"channel": _UPPER, "corner_hz": 5.0}, {"sensors": {_UPPER: SensorChain(droop_corner=5.0)}},
    ),
    "sensor_bandwidth": (
        {"channel": _UPPER, "corner_hz": 1e3}, {"sensors": {_UPPER: SensorChain(bandwidth_corner=1e3)}},
    ),
    "time_skew": ({"channel": _UPPER, "seconds": -1e-4}, {"sensors": {_UPPER: SensorChain(skew=-1e-4)}}),
}  # fmt: skip


def flat(twin: Twin) -> dict[str, object]:
    rows = {f"{part}.{field.name}": getattr(getattr(twin, part), field.name)
            for part in ("rig", "drive") for field in fields(getattr(twin, part))}  # fmt: skip
    return rows | {"sensors": dict(twin.sensors)}


def samples(twin: Twin, count: int = 1024) -> np.ndarray:
    stream = MODEL.stream(twin, SAMPLE_RATE)
    stream.drive(twin.drive)
    return stream.advance(count)


def test_the_catalogue_is_complete() -> None:
    assert set(IMPACT_BEAM) == set(CHANGES)


@pytest.mark.parametrize("name", CHANGES)
def test_an_effect_changes_its_fields_and_no_other(name: str) -> None:
    values, expected = CHANGES[name]
    before, after = flat(TWIN), flat(apply_effects(TWIN, [(name, values)]))
    assert {key: value for key, value in after.items() if value != before[key]} == expected


@pytest.mark.parametrize("name", [name for name in CHANGES if not IMPACT_BEAM[name].channels])
def test_an_effect_of_the_rig_shows_in_the_contact_force(name: str) -> None:
    changed = samples(apply_effects(TWIN, [(name, CHANGES[name][0])]))
    healthy = samples(TWIN)
    assert np.abs(changed[1] - healthy[1]).max() > 1.0
    assert changed[0] == pytest.approx(healthy[0], abs=1e-12) or name == "drive_distortion"
    assert (np.abs(changed[4]).max() > 1.0) == (name == "base_flexibility")


@pytest.mark.parametrize("name", [name for name in CHANGES if IMPACT_BEAM[name].channels])
def test_an_effect_of_a_sensor_shows_on_its_channel_only(name: str) -> None:
    changed, healthy = samples(apply_effects(TWIN, [(name, CHANGES[name][0])])), samples(TWIN)
    assert np.abs(changed[1] - healthy[1]).max() > 1.0
    its = [TWIN.channels.index(channel) for channel in CHANGES[name][1]["sensors"]]  # type: ignore[attr-defined]
    assert np.array_equal(np.delete(changed, its, axis=0), np.delete(healthy, its, axis=0))


def test_gain_and_skew_of_a_channel() -> None:
    healthy = samples(TWIN)
    gained = samples(apply_effects(TWIN, [("sensor_gain", {"channel": "yoke.force", "gain": 1.5})]))
    assert gained[3] == pytest.approx(1.5 * healthy[3], abs=1e-12)
    turned = samples(apply_effects(TWIN, [("sensor_factor", {"channel": "yoke.force", "factor": -1.0})]))
    assert np.array_equal(turned[3], -healthy[3])
    swapped = samples(apply_effects(TWIN, [("swapped_channels", {"channel": "yoke.force", "other": 2.0})]))
    assert np.array_equal(swapped, healthy[[0, 1, 3, 2, 4]])
    whole = {"channel": "contact.force_upper", "seconds": 10 / SAMPLE_RATE}
    skewed = samples(apply_effects(TWIN, [("time_skew", whole)]))
    assert skewed[1][10:] == pytest.approx(healthy[1][:-10], abs=1e-9 * healthy[1].max())


def test_scale_multiplies_what_the_scenario_has() -> None:
    wide = replace(TWIN, rig=replace(TWIN.rig, clearance=0.5e-3))
    assert apply_effects(wide, [("clearance", {"scale": 0.8})]).rig.clearance == pytest.approx(0.4e-3)


@pytest.mark.parametrize(
    ("first", "second"),
    [("clearance", "hertzian_contact"), ("base_flexibility", "shaker_mass"),
     ("pivot_friction", "sensor_gain"), ("sensor_gain", "time_skew"),
     ("drive_distortion", "pivot_compliance")],
)  # fmt: skip
def test_two_effects_are_both_in_whatever_their_order(first: str, second: str) -> None:
    one, two = ((name, CHANGES[name][0]) for name in (first, second))
    together = apply_effects(TWIN, [one, two])
    assert together == apply_effects(TWIN, [two, one])
    assert together == apply_effects(apply_effects(TWIN, [one]), [two])
    assert together not in (apply_effects(TWIN, [one]), apply_effects(TWIN, [two]))
    assert np.isfinite(samples(together, 256)).all()


def test_no_effect_leaves_the_twin_as_it_is() -> None:
    assert apply_effects(TWIN, []) == TWIN


def _outside() -> list[tuple[str, ParameterValues, str]]:
    cases: list[tuple[str, ParameterValues, str]] = []
    for name, effect in IMPACT_BEAM.items():
        inside = CHANGES[name][0]
        for parameter in effect.parameters:
            lowest, highest = parameter.intervals[0][0], parameter.intervals[-1][1]
            beyond = [highest * 1.001, lowest * 0.999 if lowest > 0 else lowest * 1.001 - 1e-9]
            beyond += [(low[1] + high[0]) / 2 for low, high in pairwise(parameter.intervals)]
            cases += [(name, {**inside, parameter.name: number}, parameter.name) for number in beyond]
    return cases


@pytest.mark.parametrize(("name", "values", "parameter"), _outside())
def test_a_parameter_outside_its_range_is_refused(name: str, values: ParameterValues, parameter: str) -> None:
    with pytest.raises(ValueError, match=rf"{name}\.{parameter} = .*: .* to "):
        apply_effects(TWIN, [(name, values)])


@pytest.mark.parametrize("name", CHANGES)
def test_the_ends_of_each_interval_are_allowed(name: str) -> None:
    for parameter in IMPACT_BEAM[name].parameters:
        for number in (end for interval in parameter.intervals for end in interval):
            apply_effects(TWIN, [(name, {**CHANGES[name][0], "third": 0.05, parameter.name: number})
                                 if name == "drive_distortion"
                                 else (name, {**CHANGES[name][0], parameter.name: number})])  # fmt: skip


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ([("gremlins", {})], "no effect 'gremlins'; known: clearance, "),
        ([("clearance", {})], "clearance takes exactly scale"),
        ([("clearance", {"scale": 1.5, "offset": 1.0})], "clearance takes exactly scale"),
        ([("sensor_gain", {"gain": 0.8})], "takes exactly channel, gain"),
        ([("sensor_gain", {"gain": 0.8, "channel": "base.acceleration"})], "sits on one of .*not base"),
        ([("sensor_bandwidth", {"corner_hz": 1e3, "channel": "drive.force"})], "sits on one of contact"),
        ([("drive_distortion", {"second": 0.03, "third": 0.03})], r"second or third is at least 0\.04"),
        ([("clearance", {"scale": 1.0})], r"clearance\.scale = 1: 0\.5 to 0\.9 or 1\.1 to 2"),
        ([("clearance", {"scale": float("nan")})], r"clearance\.scale = nan"),
    ],
)
def test_what_cannot_be_is_refused_and_said(effects: list[tuple[str, ParameterValues]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        apply_effects(TWIN, effects)


@pytest.mark.parametrize("name", ["pivot_friction", "pivot_compliance"])
def test_a_clamped_beam_has_no_pivot(name: str) -> None:
    clamped = replace(TWIN, rig=nominal("aluminium"))
    with pytest.raises(ValueError, match=f"{name} does not exist on this rig"):
        apply_effects(clamped, [(name, CHANGES[name][0])])


@pytest.mark.parametrize("name", [name for name in CHANGES if not name.startswith("pivot")])
def test_every_other_effect_exists_on_the_clamped_beam(name: str) -> None:
    clamped = replace(TWIN, rig=nominal("aluminium"))
    assert np.isfinite(samples(apply_effects(clamped, [(name, CHANGES[name][0])]), 512)).all()


def test_a_flexible_base_cannot_get_the_flexible_yoke_too() -> None:
    flexible = replace(TWIN, rig=replace(TWIN.rig, base=flexible_base()))
    with pytest.raises(ValueError, match="does not exist on this rig"):
        apply_effects(flexible, [("base_flexibility", CHANGES["base_flexibility"][0])])


def test_an_effect_whose_change_is_wrong_is_told_by_name() -> None:
    def change(twin: Any, values: Any) -> Any:
        return replace(twin, no_such_field=1.0)

    twin = Twin(nominal(), SineDrive(9.0, 20.0))
    with pytest.raises(ValueError, match=r"made_up failed \(TypeError: .*no_such_field"):
        Effect("made_up", "beam", (), change).apply(twin, {})
