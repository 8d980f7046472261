"""What is held back is what its name says, and each way to predict does what can be known."""

from __future__ import annotations

import numpy as np
import pytest

from sim_twin.surrogates import comparison
from sim_twin.surrogates.comparison import DENSE, METHODS, POINTS, SPLITS, compared
from sim_twin.surrogates.samples import Samples
from tests.sim_twin.surrogates.test_surrogate import turning


@pytest.fixture(scope="module")
def samples() -> Samples:
    settings = [(speed, gap) for speed in (150.0, 175.0, 200.0) for gap in (1.0, 1.5, 2.0)]
    runs = [turning(speed, gap, turns=9, seed=number) for number, (speed, gap) in enumerate(settings)]
    return Samples.joined(runs)


def held_back(samples: Samples, split: str) -> Samples:
    return samples[SPLITS[split](samples, np.random.default_rng(0))]


def test_splits_hold_back_what_they_say(samples: Samples) -> None:
    assert set(held_back(samples, "held-out speed").column("speed")) == {175.0}
    assert set(held_back(samples, "held-out clearance").column("clearance_1")) == {1.5}
    late = held_back(samples, "held-out cycles")
    assert set(late.runs) == set(range(9))
    assert set(late.turns) == {6, 7, 8}
    for split in (DENSE, POINTS):
        assert len(held_back(samples, split)) / len(samples) == pytest.approx(259 / 759, abs=0.02)


def test_a_split_that_the_runs_do_not_allow_of_has_no_rows(samples: Samples) -> None:
    assert compared(samples[samples.runs < 3], "held-out speed", "angle") == []


@pytest.mark.parametrize(
    "method", ["GRNN", "mean revolution", pytest.param("gradient boosting", marks=pytest.mark.long)]
)
def test_each_method_learns_what_can_be_known(
    samples: Samples, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    monkeypatch.setattr(comparison, "METHODS", {method: METHODS[method]})
    for row in compared(samples, "held-out cycles", "angle"):
        # noise of 0.1 in an rms of about 1, and what each makes of a revolution in a few hundred points
        assert row.score.rmse < 0.3


def test_another_speed_shows_what_the_nearest_did(samples: Samples, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, "METHODS", {"mean revolution": METHODS["mean revolution"]})
    (row,) = compared(samples, "held-out speed", "angle")
    assert row.score.rmse < 0.25  # the other speeds show the same over the angle


def test_time_tells_nothing_of_later_cycles(samples: Samples, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, "METHODS", {"GRNN": METHODS["GRNN"]})
    (row,) = compared(samples, "held-out cycles", "time")
    assert row.score.rmse > 0.9
