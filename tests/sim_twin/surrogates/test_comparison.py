"""What is held back is what its name says, all is judged on the same points, and each does what it can."""

from __future__ import annotations

import numpy as np
import pytest

from sim_twin.surrogates import comparison
from sim_twin.surrogates.comparison import (
    ALL,
    CLEARANCE,
    CYCLES,
    METHODS,
    NEAREST,
    POINTS,
    SPEED,
    SPLITS,
    compared,
    judged_points,
)
from sim_twin.surrogates.samples import LEARNT, Samples
from tests.sim_twin.surrogates.test_surrogate import turning

GAPS = (1.0, 1.5, 2.0)


@pytest.fixture(scope="module")
def samples() -> Samples:
    """Mean speeds as they are measured: 0.02 % off what was ordered."""
    settings = [
        (speed * off, gap)
        for speed in (150.0, 175.0, 200.0)
        for gap, off in zip(GAPS, (1, 1.0002, 0.9998), strict=True)
    ]
    runs = [turning(speed, gap, turns=12, seed=number) for number, (speed, gap) in enumerate(settings)]
    return Samples.joined(runs)


def held_back(samples: Samples, split: str) -> Samples:
    return samples[SPLITS[split](samples)]


def only(monkeypatch: pytest.MonkeyPatch, *methods: str) -> None:
    monkeypatch.setattr(comparison, "METHODS", {name: METHODS[name] for name in methods})


def test_splits_hold_back_what_they_say(samples: Samples) -> None:
    speeds = held_back(samples, SPEED).column("speed")
    assert speeds.min() > 174.9
    assert speeds.max() < 175.1
    assert set(held_back(samples, SPEED).column("clearance_1")) == set(GAPS)
    assert set(held_back(samples, CLEARANCE).column("clearance_1")) == {1.5}
    late = held_back(samples, CYCLES)
    assert set(late.runs) == set(range(9))
    assert set(late.turns) == {6, 7, 8, 9, 10, 11}
    assert len(held_back(samples, POINTS)) == 0


def test_what_is_judged_is_held_back_by_every_split(samples: Samples) -> None:
    never, windows = judged_points(samples)
    judged = windows >= 0
    assert np.mean(never) == pytest.approx(259 / 759, abs=0.02)
    assert not np.any(judged & ~never)
    assert set(samples.runs[judged]) == {4}  # in the middle of both
    for split in (CYCLES, SPEED, CLEARANCE):
        assert np.all(SPLITS[split](samples)[judged])
    times = samples.column("time")[judged]
    assert np.ptp(times) < 759 / 500  # one window: the run has no more than 1028 points in its second half
    assert len(times) == pytest.approx(259, abs=40)


@pytest.mark.parametrize("amount", [NEAREST, ALL])
def test_every_split_has_the_same_floor_and_learns_as_densely(
    samples: Samples, monkeypatch: pytest.MonkeyPatch, amount: str
) -> None:
    learnt: list[Samples] = []

    def learn(known: Samples, *_: object):
        learnt.append(known)
        return lambda inputs: np.zeros((len(inputs), 3))

    monkeypatch.setattr(comparison, "METHODS", {"nothing": learn})
    rows = [row for split in SPLITS for row in compared(samples, split, amount, "time")]
    assert [row.split for row in rows] == list(SPLITS)
    assert len({(row.score.rmse_floor, row.score.distance_floor) for row in rows}) == 1
    assert len({row.score.rmse for row in rows}) == 1  # zero for zero of the same points
    if amount == NEAREST:
        assert {len(known) for known in learnt} == {LEARNT}
        for known in learnt:
            for run in np.unique(known.runs):
                times = known.column("time")[known.runs == run]
                # 500 samples a second, a third of which nobody learns
                assert len(times) / np.ptp(times) == pytest.approx(500 * 500 / 759, rel=0.15)


def test_a_split_that_the_runs_do_not_allow_of_has_no_rows(samples: Samples) -> None:
    assert compared(samples[samples.runs < 3], SPEED, ALL, "angle") == []


@pytest.mark.parametrize(
    "method",
    ["GRNN, 500 units", "mean revolution", pytest.param("gradient boosting", marks=pytest.mark.long)],
)
def test_each_method_learns_what_can_be_known(
    samples: Samples, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    only(monkeypatch, method)
    for row in compared(samples[samples.runs == 4], CYCLES, ALL, "angle"):
        # noise of 0.1 in an rms of about 1, and what each makes of a revolution in a few hundred points
        assert row.score.rmse < 0.3


def test_another_speed_shows_what_the_nearest_did(samples: Samples, monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, "mean revolution")
    (row,) = compared(samples, SPEED, ALL, "angle")
    assert row.score.rmse < 0.25  # the other speeds show the same over the angle


def test_time_tells_of_the_cycles_that_it_learnt_and_nothing_of_later_ones(
    samples: Samples, monkeypatch: pytest.MonkeyPatch
) -> None:
    only(monkeypatch, "GRNN, 500 units", "RBF, error goal")
    for row in compared(samples, CYCLES, NEAREST, "time"):
        assert row.score.rmse > 0.9
    for row in compared(samples, POINTS, NEAREST, "time"):
        assert row.score.rmse < 0.4
