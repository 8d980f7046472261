"""Tolerances by name: each changes what it says, by what it says; a matched twin has what was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_twin.healthy import Matched, MatchedTwin
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.base.model import flexible_base
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
from sim_twin.sensors import SensorChain
from sim_twin.twin import AnyTwin, Twin
from tests.sim_twin.every_rig import RIGS


def complete(rig: object, drive: object) -> AnyTwin:
    model = next(model for model in RIGS.values() if isinstance(rig, model.parameters))
    return Twin(rig, drive, model.nominal_sensors(rig, drive))


BEAM = complete(replace(nominal(), shaker_mass=0.05), SineDrive(9.0, 20.0))
PLATE = complete(replace(nominal(), base=flexible_base("aluminium")), SineDrive(9.0, 20.0))
PLANAR = complete(replace(PlanarSliderCrank(), restitution=0.8, friction=0.02), SpeedDrive(20.0))
SPATIAL = complete(SpatialSliderCrank(), SpeedDrive(20.0))
# Found in a calibration: a stiff contact, and a gain that hangs together with the yoke's frequency.
FOUND = Matched(
    ("contact_stiffness", "yoke_frequency", "yoke.force.gain"),
    np.array([1.5, -0.5, 0.2]),
    np.array([[0.04, 0.0, 0.0], [0.0, 0.25, 0.2], [0.0, 0.2, 0.49]]),
)
every_rig = pytest.mark.parametrize(
    "twin", [BEAM, PLATE, PLANAR, SPATIAL], ids=["beam", "plate", "planar", "spatial"]
)


@every_rig
def test_each_tolerance_changes_what_it_names_by_its_deviations(twin: AnyTwin) -> None:
    for tolerance in twin.model.tolerances(twin):
        before, after = tolerance.value(twin), tolerance.value(tolerance.off(twin, 2.0))
        by = 2 * tolerance.deviation * (before if tolerance.relative else 1.0)
        assert after - before == pytest.approx(by, rel=1e-6, abs=1e-15), tolerance.name


@every_rig
def test_names_are_unique_and_nothing_off_is_nothing_changed(twin: AnyTwin) -> None:
    tolerances = twin.model.tolerances(twin)
    assert len({each.name for each in tolerances}) == len(tolerances)
    for tolerance in tolerances:
        assert tolerance.off(twin, 0.0) == twin, tolerance.name


@every_rig
def test_no_rig_is_impossible(twin: AnyTwin) -> None:
    for tolerance in twin.model.tolerances(twin):
        for z in (-30.0, 30.0):
            tolerance.off(twin, z)


def test_restitution_stays_at_most_one() -> None:
    restitution = next(each for each in PLANAR.model.tolerances(PLANAR) if each.name == "restitution")
    assert restitution.off(PLANAR, 50.0).rig.restitution == 1.0


def test_a_heavier_crank_turns_about_as_much_more() -> None:
    mass = next(each for each in PLANAR.model.tolerances(PLANAR) if each.name == "crank_mass")
    heavier = mass.off(PLANAR, 1.0).rig
    assert heavier.crank_inertia / PLANAR.rig.crank_inertia == pytest.approx(
        heavier.crank_mass / PLANAR.rig.crank_mass
    )


def test_only_the_hertzian_law_is_off_where_it_holds() -> None:
    hertz = replace(BEAM, rig=replace(BEAM.rig, hertz=1e10))
    stiffness = next(each for each in hertz.model.tolerances(hertz) if each.name == "contact_stiffness")
    assert stiffness.off(hertz, 1.0).rig.hertz == pytest.approx(1.05e10)
    assert stiffness.off(BEAM, 1.0).rig.hertz is None


def test_a_matched_twin_has_what_was_found() -> None:
    twin = BEAM.model.matched(BEAM, FOUND)
    assert twin.rig.contact_stiffness == pytest.approx(1.5e7 * (1 + 0.05 * 1.5))
    assert twin.rig.yoke_frequency == pytest.approx(700 * (1 - 0.02 * 0.5))
    yoke = twin.sensors["yoke.force"]
    assert isinstance(yoke, SensorChain)
    assert yoke.gain == pytest.approx(1 + 0.01 * 0.2)
    assert yoke.noise == 0.05
    assert (twin.rig.beam, twin.rig.clearance, twin.drive) == (BEAM.rig.beam, BEAM.rig.clearance, BEAM.drive)


@pytest.mark.long
def test_healthy_rigs_about_a_matched_twin_differ_by_what_was_left_open() -> None:
    twin, rng = BEAM.model.matched(BEAM, FOUND), np.random.default_rng(3)
    rigs = [twin.model.draw_healthy(twin, rng, rng) for _ in range(1000)]
    assert not any(isinstance(rig, MatchedTwin) for rig in rigs)
    stiffness = np.array([rig.rig.contact_stiffness for rig in rigs]) / twin.rig.contact_stiffness - 1
    yoke = np.array([rig.rig.yoke_frequency for rig in rigs]) / twin.rig.yoke_frequency - 1
    gain = np.array([rig.sensors["yoke.force"].gain for rig in rigs])
    modulus = np.array([rig.rig.beam.E for rig in rigs]) / 207e9
    # 1,000 draws know a deviation to 2.2 %; four of those.
    assert stiffness.std() == pytest.approx(0.05 * 0.2, rel=0.09)
    assert yoke.std() == pytest.approx(0.02 * 0.5, rel=0.09)
    assert modulus.std() == pytest.approx(0.01, rel=0.09)
    # and a correlation r to (1 - r^2) / sqrt(1,000).
    expected = 0.2 / (0.5 * 0.7)
    assert np.corrcoef(yoke, gain)[0, 1] == pytest.approx(expected, abs=4 * (1 - expected**2) / np.sqrt(1000))


def test_a_calibration_of_other_parts_changes_nothing() -> None:
    other = Matched(("cover.acceleration_center.gain",), np.array([2.0]), np.array([[0.1]]))
    twin = BEAM.model.matched(BEAM, other)
    drawn = [
        BEAM.model.draw_healthy(each, *(np.random.default_rng(5) for _ in range(2))) for each in (BEAM, twin)
    ]
    assert drawn[0] == drawn[1]


def test_what_a_run_sets_anew_is_never_matched() -> None:
    clearance = Matched(("clearance",), np.array([2.0]), np.array([[0.1]]))
    assert BEAM.model.matched(BEAM, clearance).rig.clearance == BEAM.rig.clearance
