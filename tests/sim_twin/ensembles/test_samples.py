"""Samples of many runs are those of each run alone, through its measuring chains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence
from numpy.typing import NDArray

from sim_twin.ensembles.population import Population
from sim_twin.ensembles.samples import Samples
from sim_twin.ensembles.simulate import simulate
from sim_twin.ensembles.variant import Variant
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.planar_slider_crank.rig import MODEL as CRANK_MODEL
from sim_twin.status import Status
from sim_twin.twin import Twin
from tests.sim_twin.ensembles.stand_ins import BEAM, Beyond

RATE = 51_200.0
UPPER = ("contact.force_upper",)
HEALTHY = Population(BEAM).variants(5, 3)


def samples(
    variants: list[Variant], settle: float = 0.0, duration: float = 0.01
) -> list[NDArray[np.float32]]:
    outcomes = simulate(variants, Samples(BEAM.channels, RATE, settle, duration))
    return [outcome.value for outcome in outcomes]


def largest(values: NDArray[np.float32]) -> float:
    return float(np.max(values))


def test_first_impacts_are_those_of_the_exact_solver_through_the_same_chains() -> None:
    phase = 0.2
    (drive, upper, _, yoke, base) = samples([Variant(BEAM, phase)])[0]
    stream = MODEL.stream(BEAM, RATE)
    stream.drive(BEAM.drive, phase)
    exact = stream.advance(len(drive))
    assert upper.dtype == np.float32
    # float32 of 9 N
    assert drive == pytest.approx(exact[0], abs=1e-6)
    first = slice(0, 250)  # 4.9 ms: the first impact, about a millisecond of it
    assert exact[1, first].max() > 20
    # half a step of 4.9 us in the time of an impact that lasts some 200 us, and 0.5 % of its peak
    assert upper[first] == pytest.approx(exact[1, first], abs=0.02 * exact[1, first].max())
    assert yoke[first] == pytest.approx(exact[3, first], abs=0.02 * exact[1, first].max())
    assert not base.any()


def test_accelerations_are_in_their_rows() -> None:
    effect = {"frequency_hz": 400.0, "mass_kg": 1.0, "damping_ratio": 0.02}
    softer = MODEL.with_effects(BEAM, [("base_flexibility", effect)])
    twin = replace(softer, rig=replace(softer.rig, stations=(50,)))
    wanted = Samples(("base.acceleration", "beam.acceleration_50"), RATE, 0.0, 0.005)
    (outcome,) = simulate([Variant(twin)], wanted)
    stream = MODEL.stream(twin, RATE)
    stream.drive(twin.drive)
    exact = stream.advance(256)[4:]
    for row, expected in zip(outcome.value, exact, strict=True):
        # as above; the beam's high modes shift by half a step each
        assert row == pytest.approx(expected, abs=0.05 * np.abs(expected).max())


def test_the_window_comes_after_settle_and_a_run_has_the_same_bits_in_any_company() -> None:
    quiet = [replace(each, noise=None) for each in HEALTHY]
    whole, late = samples(quiet, 0.0, 0.03), samples(quiet[2:3], 0.02, 0.01)
    assert late[0].shape == (5, 512)
    assert np.array_equal(late[0], whole[2][:, 1024:])


def test_noise_is_the_variant_s_own() -> None:
    noisy = Variant(BEAM, noise=SeedSequence(1))
    here, there = samples([noisy, Variant(BEAM)]), samples([Variant(BEAM), noisy])
    assert np.array_equal(here[0], there[1])
    noise = here[0][1] - here[1][1]
    # 512 samples of the 0.05 N that a force channel has: 3 % standard error
    assert np.std(noise) == pytest.approx(0.05, rel=0.12)


def test_what_a_function_makes_of_the_samples_is_kept_instead() -> None:
    whole = simulate(HEALTHY, Samples(UPPER, RATE, 0.0, 0.01))
    reduced = simulate(HEALTHY, Samples(UPPER, RATE, 0.0, 0.01, reduce=largest))
    assert [outcome.value for outcome in reduced] == [largest(outcome.value) for outcome in whole]


def test_long_records_come_in_smaller_pieces_so_that_memory_lasts() -> None:
    assert Samples(UPPER, RATE, 1.0, 5.0).together == 16
    # 60 s of five channels are 61 MB
    assert Samples(BEAM.channels, RATE, 1.0, 60.0).together == 1


def test_a_run_that_diverges_is_marked_and_takes_no_other_along() -> None:
    beyond = replace(BEAM, drive=Beyond(9.0, 20.0))
    outcomes = simulate([Variant(BEAM), Variant(beyond)], Samples(BEAM.channels, RATE, 0.0, 0.05))
    assert [outcome.status for outcome in outcomes] == [Status.COMPLETED, Status.DIVERGED]
    assert outcomes[1].value is None
    assert np.isfinite(outcomes[0].value).all()


def test_a_rig_without_lanes_is_run_one_by_one() -> None:
    crank = Twin(PlanarSliderCrank(), SpeedDrive(20.0))
    wanted = Samples(crank.channels, 25_600.0, 0.0, 0.02)
    (outcome,) = simulate([Variant(crank, 0.4)], wanted)
    stream = CRANK_MODEL.stream(crank, 25_600.0)
    stream.drive(crank.drive, 0.4)
    assert np.array_equal(outcome.value, stream.advance(512).astype(np.float32))
