"""Drawn rigs: each run from its own seed, effects and operating points within what was asked."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from sim_twin.ensembles.population import Between, Population
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.sensors import SensorChain
from sim_twin.twin import AnyTwin, Twin
from tests.sim_twin.ensembles.stand_ins import BEAM
from tests.sim_twin.every_rig import RIGS

CRANK = Twin(PlanarSliderCrank(), SpeedDrive(20.0))
RUNS = 400


def test_a_run_depends_on_its_seed_and_number_alone() -> None:
    few, many = Population(BEAM).variants(3, 7), Population(BEAM).variants(9, 7)
    assert [each.twin for each in few] == [each.twin for each in many[:3]]
    assert [each.phase for each in few] == [each.phase for each in many[:3]]
    assert Population(BEAM).variant(8, 0).twin != few[0].twin
    noise = [np.random.default_rng(each.noise).standard_normal() for each in many]
    assert len(set(noise)) == len(many)


def test_healthy_rigs_spread_as_section_5_says() -> None:
    variants = Population(BEAM).variants(RUNS, 0)
    clearance = np.array([each.twin.rig.clearance for each in variants]) / BEAM.rig.clearance
    # standard errors of a mean and of a deviation over 400 draws of 2 %: 0.001 and 0.0007
    assert np.mean(clearance) == pytest.approx(1, abs=4e-3)
    assert np.std(clearance) == pytest.approx(0.02, abs=3e-3)
    phases = np.array([each.phase for each in variants])
    # 400 uniform phases: the mean direction is within 0.15 but for one seed in ten thousand
    assert abs(np.mean(np.exp(1j * phases))) < 0.15


def test_without_tolerances_every_run_is_the_twin_itself() -> None:
    variant = Population(BEAM, healthy=False, any_phase=False).variant(0, 5)
    assert variant.twin == BEAM
    assert variant.phase == 0
    assert variant.noise is None


@pytest.mark.parametrize("twin", [BEAM, CRANK])
def test_open_parameters_of_every_effect_stay_in_their_ranges_and_travel(twin: AnyTwin) -> None:
    model = next(model for model in RIGS.values() if isinstance(twin.rig, model.parameters))
    for name in model.effects:
        population = Population(twin, ((name, {}),), healthy=False)
        variants = population.variants(5, 1)  # refused by the effect itself if out of range
        counted = all(parameter.whole for parameter in model.effects[name].parameters)
        assert len({repr(each.twin) for each in variants}) in (range(2, 6) if counted else (5,)), name
        assert pickle.loads(pickle.dumps(variants))[0].twin == variants[0].twin  # noqa: S301


def test_both_intervals_of_a_range_are_drawn_from_and_given_values_stay() -> None:
    scales = [
        Population(BEAM, (("clearance", {}),), healthy=False).variant(2, run).twin.rig.clearance
        / BEAM.rig.clearance
        for run in range(60)
    ]
    assert {bool(scale > 1) for scale in scales} == {True, False}
    population = Population(BEAM, (("sensor_gain", {"channel": "yoke.force"}),), healthy=False)
    changed = population.variant(0, 0).twin.sensors["yoke.force"]
    assert isinstance(changed, SensorChain)
    assert changed.gain != 1


def test_operating_points_take_turns_or_fill_a_range() -> None:
    slow, fast = SineDrive(9.0, 19.5), SineDrive(9.0, 21.0)
    turns = Population(BEAM, points=(slow, fast), healthy=False).variants(4, 0)
    assert [each.twin.drive for each in turns] == [slow, fast, slow, fast]
    drawn = Population(BEAM, points=Between(slow, fast), healthy=False).variants(50, 0)
    frequencies = [each.twin.drive.frequency for each in drawn]
    assert 19.5 <= min(frequencies) < 19.8
    assert 20.7 < max(frequencies) <= 21.0
    assert {each.twin.drive.amplitude for each in drawn} == {9.0}


def test_what_a_rig_cannot_have_is_refused() -> None:
    clamped: AnyTwin = replace(BEAM, rig=nominal("aluminium"))
    with pytest.raises(ValueError, match="pivot_friction does not exist on this rig"):
        Population(clamped, (("pivot_friction", {}),)).variant(0, 0)
    with pytest.raises(ValueError, match="no effect 'rust'"):
        Population(BEAM, (("rust", {}),)).variant(0, 0)
    with pytest.raises(ValueError, match=r"clearance.scale = 1: "):
        Population(BEAM, (("clearance", {"scale": 1.0}),)).variant(0, 0)
