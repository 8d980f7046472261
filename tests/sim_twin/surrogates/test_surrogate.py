"""What a surrogate learns from, what it says of itself, and what it refuses."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from sim_twin.surrogates.judging import scores
from sim_twin.surrogates.samples import COLUMNS, Samples, mean_cycle
from sim_twin.surrogates.surrogate import learnt, learnt_and_tested

CHANNELS = ("x", "y", "z")
RATE = 500.0


def turning(speed_rpm: float = 200.0, clearance: float = 1.0, turns: int = 12, seed: int = 0) -> Samples:
    """A run whose channels go with the crank's angle, the more the wider the clearance, with noise of 0.1."""
    times = np.arange(round(turns * 60 / speed_rpm * RATE)) / RATE
    angle = 2 * math.pi * speed_rpm / 60 * times
    columns = {"time": times, "angle": angle, "speed": speed_rpm, "clearance_1": clearance}
    columns |= {"clearance_2": 1.0, "density": 7800.0}
    inputs = np.column_stack([np.broadcast_to(columns[name], len(times)) for name in COLUMNS])
    outputs = clearance * np.column_stack([np.sin(angle), np.cos(2 * angle), np.sin(3 * angle)])
    noise = np.random.default_rng(seed).normal(scale=0.1, size=outputs.shape)
    run = np.zeros(len(times), np.int64)
    return Samples(inputs, outputs + noise, run, np.int64(angle / (2 * math.pi)))


def three_clearances() -> Samples:
    return Samples.joined([turning(clearance=each, seed=number) for number, each in enumerate((1, 1.5, 2))])


@pytest.mark.long
@pytest.mark.parametrize(("kind", "given"), [("rbf", {"max_units": 40}), ("grnn", {})])
def test_a_clearance_between_those_it_learnt_is_predicted(kind, given) -> None:
    several = [turning(clearance=1 + number / 8, seed=number) for number in range(9)]
    found = learnt(Samples.joined(several), "rig", CHANNELS, "angle", kind, **given)
    asked = turning(clearance=1.68, seed=99)
    # the noise is 0.1
    assert np.sqrt(np.mean((found.predict(asked.inputs) - asked.outputs) ** 2)) < 0.2


def test_an_input_that_was_constant_is_dropped_and_said() -> None:
    found = learnt(three_clearances(), "rig", CHANNELS, "angle", "grnn", width=0.1)
    assert found.features.constants == ("speed", "clearance_2", "density")
    assert len(found.mean) == 3  # cosine and sine of the angle, the first clearance
    assert found.ranges["clearance_1"] == (1.0, 2.0)


def test_what_lies_outside_of_what_it_learnt_is_named() -> None:
    found = learnt(three_clearances(), "rig", CHANNELS, "angle", "grnn", width=0.1)
    assert found.outside(turning(clearance=1.2).inputs) == {}
    assert found.outside(turning(speed_rpm=230.0, clearance=2.2).inputs) == {
        "speed": (230.0, 230.0),
        "clearance_1": (2.2, 2.2),
    }


def test_speeds_that_a_drive_holds_alike_are_one() -> None:
    runs = [turning(speed, gap) for speed, gap in ((199.96, 1), (200.03, 1), (199.99, 2))]
    found = learnt(Samples.joined(runs), "rig", CHANNELS, "angle", "grnn", width=0.1)
    assert "speed" in found.features.constants
    assert found.outside(turning(speed_rpm=200.2).inputs) == {}
    assert found.outside(turning(speed_rpm=201.0).inputs).keys() == {"speed"}
    assert list(np.unique(Samples.joined(runs).classes("speed"))) == [0]


def test_time_has_a_range_and_an_angle_has_none() -> None:
    over_time = learnt(turning(), "rig", CHANNELS, "time", "grnn", width=0.1)
    assert over_time.outside(turning(turns=13).inputs).keys() == {"time"}
    over_angle = learnt(turning(), "rig", CHANNELS, "angle", "grnn", width=0.1)
    assert over_angle.outside(turning(turns=13).inputs) == {}


def test_it_is_tested_on_revolutions_that_it_did_not_see() -> None:
    found = learnt_and_tested(three_clearances(), "rig", CHANNELS, "angle", "grnn")
    assert found.tested.keys() == set(CHANNELS)
    for score in found.tested.values():
        assert 0.9 < score.rmse_over_floor < 1.6
        assert score.distance < 0.1
    # over time, revolutions that come later lie outside of what was learnt
    over_time = learnt_and_tested(three_clearances(), "rig", CHANNELS, "time", "grnn", width=0.1)
    assert all(score.rmse_over_floor > 3.0 for score in over_time.tested.values())


def spoilt(what: str) -> Samples:
    run = turning()
    inputs, outputs = run.inputs.copy(), run.outputs.copy()
    if what == "nan":
        outputs[:, 1] = np.nan
    elif what == "still":
        inputs[:, list(COLUMNS).index("angle")] = 1.0
    elif what == "angle":
        inputs[7, list(COLUMNS).index("angle")] = np.nan
    return Samples(inputs, outputs, run.runs, run.turns)


@pytest.mark.parametrize(
    ("samples", "over", "told"),
    [
        (lambda: turning()[:10], "angle", "10 samples are too few"),
        (lambda: turning(turns=2), "angle", "fewer than 3 revolutions"),
        (lambda: spoilt("nan"), "angle", "y: values that are not finite"),
        (lambda: spoilt("angle"), "angle", "angle: not known for every sample"),
        (lambda: spoilt("still"), "angle", "every input is the same"),
    ],
)
def test_what_cannot_be_learnt_from_is_refused(samples: Callable[[], Samples], over, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        learnt(samples(), "rig", CHANNELS, over, "rbf")


def test_a_mean_cycle_is_what_repeats() -> None:
    run = turning(turns=100)
    found = mean_cycle(run, np.array([-0.5 * math.pi, 0.25 * math.pi]))
    # 10 samples of a noise of 0.1 in half a degree at most, of a sine that moves 0.03 within it
    assert found == pytest.approx(np.array([[-1, -1, 1], [math.sqrt(0.5), 0, math.sqrt(0.5)]]), abs=0.15)


def test_scores_tell_a_right_distribution_from_a_right_mean() -> None:
    run, again = turning(turns=60), turning(turns=60, seed=1)
    same, flat = scores(run, again.outputs), scores(run, np.zeros_like(run.outputs))
    for each in same:
        assert each.distance_over_floor < 3
        assert each.rmse_over_floor == pytest.approx(math.sqrt(2), rel=0.1)
    for each in flat:
        assert each.rmse == pytest.approx(1.0, abs=0.01)
        assert each.distance_over_floor > 10


@pytest.mark.parametrize("kept", [1.0, 0.05])
def test_a_floor_is_the_same_of_few_samples_as_of_all(kept: float) -> None:
    """Scatter alone, of which each sample would be most of its own mean where there are few."""
    run, random = turning(turns=40), np.random.default_rng(1)
    noise = Samples(run.inputs, random.normal(size=run.outputs.shape), run.runs, run.turns)
    few = noise[random.random(len(noise)) < kept]
    for score in scores(few, 0 * few.outputs, few):
        assert score.rmse_floor == pytest.approx(1.0, abs=0.1)


def test_a_floor_of_distributions_is_of_whole_revolutions() -> None:
    """Half a revolution more shows what the whole ones do not: it is in no floor."""
    run = turning(turns=8)
    repeats = Samples(
        run.inputs, np.floor(run.column("angle") / np.pi)[:, None] % 2 * np.ones(3), run.runs, run.turns
    )
    cut = repeats[repeats.column("angle") < 6.5 * 2 * math.pi]
    for score in scores(cut, cut.outputs):
        assert score.distance_floor == pytest.approx(0.0, abs=0.01)
    for score in scores(cut[cut.turns < 2], cut[cut.turns < 2].outputs):
        assert score.distance_floor == pytest.approx(0.0, abs=0.01)
    for score in scores(cut[cut.turns < 1], cut[cut.turns < 1].outputs):
        assert score.distance_floor == 0.0


def test_the_floor_of_few_revolutions_is_that_of_many() -> None:
    """Nothing but scatter from turn to turn, of which a mean revolution tells nothing."""
    floors = []
    for turns in (4, 80):
        run, random = turning(turns=turns), np.random.default_rng(turns)
        scatter = random.normal(size=(turns, 3))[run.turns]
        floors += [
            score.rmse_floor
            for score in scores(Samples(run.inputs, scatter, run.runs, run.turns), 0 * scatter)
        ]
    # in standard deviations about the mean of so many turns: n / (n - 1) in all
    assert floors[:3] == pytest.approx([math.sqrt(4 / 3)] * 3, rel=0.02)
    assert floors[3:] == pytest.approx([1.0] * 3, rel=0.02)
