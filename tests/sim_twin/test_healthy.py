"""What a healthy rig may differ by: the draws have the spread that the physics states."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import MODEL, nominal_sensors
from sim_twin.sensors import SensorChain
from sim_twin.twin import Twin, changed

DRAWS = 2000
# A standard deviation from 2,000 draws has a standard error of 1 / sqrt(4,000) = 1.6 %; four of them.
SPREAD = 0.064
TWIN = Twin(replace(nominal(), shaker_mass=0.1), SineDrive(9.0, 20.0), nominal_sensors(nominal()))


@cache
def draws() -> list[Twin]:
    rng = np.random.default_rng(20)
    return [MODEL.draw_healthy(TWIN, rng) for _ in range(DRAWS)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("value", "deviation"),
    [
        (lambda twin: twin.rig.beam.E / 207e9, 0.01),
        (lambda twin: twin.rig.beam.rho / 7800, 0.005),
        (lambda twin: twin.rig.beam.length / 0.28, 0.003),
        (lambda twin: twin.rig.beam.width / 0.019, 0.003),
        (lambda twin: twin.rig.beam.thickness / 0.00635, 0.003),
        (lambda twin: twin.rig.shaker_mass / 0.1, 0.003),
        (lambda twin: twin.rig.contact_stiffness / 1.5e7, 0.05),
        (lambda twin: twin.rig.contact_damping / 20, 0.2),
        (lambda twin: twin.rig.clearance / 0.127e-3, 0.02),
        (lambda twin: twin.rig.yoke_frequency / 700, 0.02),
        (lambda twin: twin.drive.amplitude / 9, 0.01),
        (lambda twin: twin.drive.frequency / 20, 2e-4),
        (lambda twin: twin.sensors["contact.force_upper"].gain, 0.005),
        (lambda twin: twin.sensors["yoke.force"].gain, 0.01),
        (lambda twin: 1 + twin.sensors["contact.force_lower"].skew, 2e-6),
        (lambda twin: twin.rig.modal_damping[3] / 0.01, 0.15),
    ],
)
def test_standard_deviations(value: object, deviation: float) -> None:
    values = np.array([value(twin) for twin in draws()])  # type: ignore[operator]
    assert values.std() == pytest.approx(deviation, rel=SPREAD)
    assert abs(values.mean() - 1) < 4 * deviation / np.sqrt(DRAWS)


def test_modal_damping_varies_in_common_and_mode_by_mode() -> None:
    zeta = np.array([twin.rig.modal_damping for twin in draws()]) / 0.01
    assert zeta.mean(axis=1).std() == pytest.approx(np.sqrt(0.12**2 + 0.09**2 / 15), rel=SPREAD)
    correlation = np.corrcoef(zeta[:, 2], zeta[:, 9])[0, 1]
    assert correlation == pytest.approx(0.12**2 / 0.15**2, abs=4 * (1 - 0.64**2) / np.sqrt(DRAWS))


def test_what_has_no_tolerance_stays() -> None:
    fixed = [
        (twin.rig.clamped, twin.rig.rest_offset, twin.rig.hertz, twin.rig.base, twin.rig.pivot_friction,
         twin.rig.drive_position, twin.drive.second, twin.drive.offset, twin.rig.beam.elements)
        for twin in draws()
    ]  # fmt: skip
    assert set(fixed) == {(False, 0.0, None, None, 0.0, 0.69, 0.0, 0.0, 37)}


def test_every_draw_is_a_possible_rig() -> None:
    for twin in draws():
        rig = twin.rig
        assert min(rig.clearance, rig.contact_damping, rig.contact_stiffness, *rig.modal_damping) > 0


def test_draws_are_independent_of_each_other() -> None:
    stiffness = np.array([twin.rig.contact_stiffness for twin in draws()])
    clearance = np.array([twin.rig.clearance for twin in draws()])
    gain = np.array([twin.sensors["contact.force_upper"].gain for twin in draws()])
    for a, b in ((stiffness, clearance), (stiffness, gain), (clearance[1:], clearance[:-1])):
        assert abs(np.corrcoef(a, b)[0, 1]) < 4 / np.sqrt(DRAWS)


def test_the_same_seed_draws_the_same_rig() -> None:
    first, second = (MODEL.draw_healthy(TWIN, np.random.default_rng(5)) for _ in range(2))
    assert first == second
    assert first != MODEL.draw_healthy(TWIN, np.random.default_rng(6))


def test_effects_of_sensors_survive_the_draw() -> None:
    broken = MODEL.with_effects(
        TWIN,
        [
            ("sensor_gain", {"channel": "contact.force_upper", "gain": 0.7}),
            ("sensor_droop", {"channel": "contact.force_upper", "corner_hz": 3.0}),
            ("sensor_bandwidth", {"channel": "yoke.force", "corner_hz": 1e3}),
            ("time_skew", {"channel": "drive.force", "seconds": 5e-4}),
        ],
    )
    drawn = MODEL.draw_healthy(broken, np.random.default_rng(5)).sensors
    upper = drawn["contact.force_upper"]
    assert upper.gain == pytest.approx(0.7, rel=0.03)
    assert upper.gain != 0.7
    assert upper.droop_corner == 3.0
    assert drawn["yoke.force"].bandwidth_corner == 1e3
    assert drawn["drive.force"].skew == pytest.approx(5e-4, abs=1e-5)


@pytest.mark.parametrize(
    ("channel", "noise"),
    [("drive.force", 0.02), ("contact.force_upper", 0.05), ("contact.force_lower", 0.05),
     ("yoke.force", 0.05), ("base.acceleration", 0.03), ("beam.acceleration_50", 0.03)],
)  # fmt: skip
def test_noise(channel: str, noise: float) -> None:
    rig = replace(nominal(), stations=(50,))
    assert nominal_sensors(rig)[channel] == SensorChain(noise=noise)
    assert MODEL.draw_healthy(Twin(rig, TWIN.drive), np.random.default_rng(1)).sensors[channel].noise == noise


def test_a_place_within_another_is_changed_as_well() -> None:
    def more(part: dict[str, float]) -> dict[str, float]:
        return {**part, "c": 3.0}

    both = {("a",): more, ("a", "b"): lambda old: 2.0 * old, ("none", "x"): lambda old: 0.0}
    assert changed({"a": {"b": 1.0}, "none": None}, both) == {"a": {"b": 2.0, "c": 3.0}, "none": None}
