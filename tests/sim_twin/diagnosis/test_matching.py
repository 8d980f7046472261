"""Calibration: tolerances are recovered from runs of another program, and what is not healthy is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from daq.errors import SimulationFailed
from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.discrepancy import Discrepancy
from sim_twin.diagnosis.fingerprint import Cell, Columns, Layout
from sim_twin.diagnosis.matching import (
    Match,
    Rigs,
    healthy_draws,
    match,
    match_among,
    matched_campaign,
    simulated_rigs,
)
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.subject import Observed
from sim_twin.healthy import Matched
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.twin import Twin

RATE, FREQUENCY = 25_600.0, 20.0
SCENARIO = {
    "beam": "steel", "clearance": 0.127e-3, "frequency": FREQUENCY, "amplitude": 9.0,
    "sample_rate": RATE, "settle": 1.0, "duration": 2.0,
}  # fmt: skip
RIG_SEED = 4
WEAK_SENSOR = {"name": "sensor_gain", "parameters": {"channel": "contact.force_upper", "gain": 0.8}}


def twin() -> Twin[Any, Any]:
    rig, drive = nominal(), SineDrive(9.0, FREQUENCY)
    return Twin(rig, drive, MODEL.nominal_sensors(rig, drive))


def campaign() -> Campaign:
    channels = twin().channels
    columns = Columns(channels, channels[1:], FREQUENCY, RATE)
    return Campaign((RunSetting(twin(), columns, 8, 12),))


DRAWS = healthy_draws(160, np.random.default_rng(1))


@cache
def observed() -> list[Observed]:
    return campaign().observe(DRAWS)


@cache
def rigs() -> Rigs:
    return simulated_rigs(campaign(), DRAWS, observed())


def recorded(effects: tuple[dict[str, Any], ...]) -> NDArray[np.float32]:
    """Fingerprints of a run of another program."""
    from benchmarks.blind.beam.record import record

    recording = record(SCENARIO, effects, RIG_SEED, 1)
    shown = {name: values.astype(np.float32) for name, values in recording.channels.items()}
    return campaign().runs[0].blocks_of(shown)


def matched_to_recording(effects: tuple[dict[str, Any], ...] = ()) -> Match:
    return match_among(rigs(), Moments(campaign().layout), recorded(effects))


@pytest.mark.long
def test_the_rig_of_another_program_is_found() -> None:
    from benchmarks.blind.beam.rig import jittered
    from benchmarks.blind.beam.rig import nominal as nominal_truth

    truth = jittered(nominal_truth(SCENARIO), np.random.default_rng([RIG_SEED, 0]))
    found = matched_to_recording()
    assert found.healthy
    known = found.matched
    places = {
        "yoke_frequency": (truth.head / 700 - 1) / 0.02,
        "contact_stiffness": (truth.upper.stiffness / 1.5e7 - 1) / 0.05,
    }
    for name, place in places.items():
        deviation = known.deviation[known.names.index(name)]
        assert deviation < 0.6
        # Three deviations, which are themselves known to a tenth from so few rigs.
        assert abs(known.mean_of(name) - place) < 3.3 * deviation, name
    assert known.deviation[known.names.index("shaker_mass")] > 0.95


@pytest.mark.long
@pytest.mark.parametrize(
    "effect",
    [
        WEAK_SENSOR,
        {
            "name": "base_flexibility",
            "parameters": {"frequency_hz": 600.0, "mass_kg": 3.0, "damping_ratio": 0.02},
        },
    ],
    ids=lambda effect: str(effect["name"]),
)
def test_a_rig_with_a_fault_is_not_calibrated_away(effect: dict[str, Any]) -> None:
    assert not matched_to_recording((effect,)).healthy


def test_of_a_rig_that_is_known_to_be_healthy_what_lies_beyond_is_the_twins_discrepancy() -> None:
    measured = recorded((WEAK_SENSOR,))
    matches = [
        match(
            campaign(),
            measured,
            lambda _: observed(),
            len(DRAWS),
            np.random.default_rng(1),
            (),
            known_healthy,
        )
        for known_healthy in (False, True)
    ]
    assert [each.healthy for each in matches] == [False, True]


def test_simulated_rigs_differ_by_the_discrepancies_of_their_campaign_in_every_block() -> None:
    draws = [replace(each, blocks=2) for each in healthy_draws(2, np.random.default_rng(3))]
    known = (Discrepancy("yoke.force", "rms", 0.5),)
    apart = [
        with_it[0] - without[0]
        for with_it, without in zip(
            replace(campaign(), discrepancies=known).observe(draws), campaign().observe(draws), strict=True
        )
        if with_it[0] is not None and without[0] is not None
    ]
    inside = [(cell.channel, cell.what) == ("yoke.force", "rms") for cell in campaign().layout.of_numbers]
    assert len(apart) == 2
    for each in apart:
        assert each[0] == pytest.approx(each[1], abs=1e-4)
        assert np.abs(each[0][inside]).max() > 0.1
        assert not each[0][np.logical_not(inside)].any()
    assert apart[0][0][inside] != pytest.approx(apart[1][0][inside], abs=0.05)


def test_the_campaign_draws_rigs_where_they_are_said_to_lie() -> None:
    found = Matched(("yoke_frequency",), np.array([1.0]), np.array([[1e-12]]))
    matched = matched_campaign(campaign(), found).runs[0].twin
    assert matched.rig.yoke_frequency == pytest.approx(714.0)
    drawn = [
        MODEL.draw_healthy(matched, *(np.random.default_rng(seed) for _ in range(2))) for seed in range(3)
    ]
    # The deviation left is 1e-6 of 2 %.
    assert [each.rig.yoke_frequency for each in drawn] == pytest.approx([714.0] * 3, rel=1e-6)


def test_too_few_rigs_are_no_calibration() -> None:
    draws = healthy_draws(20, np.random.default_rng(0))
    with pytest.raises(SimulationFailed, match="only 0 of 20 healthy rigs"):
        simulated_rigs(campaign(), draws, [()] * 20)


MAP = np.random.default_rng(8).standard_normal((3, 60))
NAMES = ("told", "hardly told", "told, too", "untold", "untold, too")
CELLS = Layout(tuple(Cell(0, f"number {k}", "share of time", 1) for k in range(60)))


def linear_rigs(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 5) and two blocks of 60 numbers that follow the first three, with scatter."""
    places = rng.standard_normal((count, 5))
    strength = np.array([3.0, 0.1, 1.0])
    own = (places[:, :3] * strength) @ MAP
    return places, own[:, None] + 3 * rng.standard_normal((count, 2, 60))


@cache
def linear_matches() -> tuple[np.ndarray, list[Matched]]:
    places, shown = linear_rigs(200, np.random.default_rng(0))
    moments = Moments(CELLS)
    others, seen = linear_rigs(40, np.random.default_rng(1))
    known = Rigs(NAMES, places, moments(shown))
    with threadpool_limits(1, user_api="blas"):  # matrices too small for threads to pay
        return others, [match_among(known, moments, blocks).matched for blocks in seen]


def test_deviations_are_honest_where_everything_is_linear() -> None:
    places, found = linear_matches()
    off = np.array([(each.mean - place) / each.deviation for place, each in zip(places, found, strict=True)])
    # A mean square of 40 normal numbers is 1 +- 0.22; three of those.
    assert np.mean(off**2, axis=0) == pytest.approx(1.0, abs=0.67)


def test_what_is_told_is_told_and_the_rest_stays_open() -> None:
    _, found = linear_matches()
    deviation = np.mean([each.deviation for each in found], axis=0)
    assert deviation[0] < 0.2
    assert deviation[2] < 0.5
    assert deviation[3:] == pytest.approx(1.0, abs=0.03)
