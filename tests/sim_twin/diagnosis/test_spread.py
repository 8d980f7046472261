"""How wide the tolerances of a lab are, learnt from a few of its rigs."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.matching import Rigs
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.spread import Spread, spread_among

NUMBERS = 80
NAMES = ("first", "second", "third", "fourth", "not seen")
MAP = np.random.default_rng(2).standard_normal((4, NUMBERS))
CELLS = Layout(tuple(Cell(0, f"number {k}", "share of time", 1) for k in range(NUMBERS)))
WIDE = 2.5


def shown(places: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Two blocks of numbers that follow the first four places (n, 5), with scatter."""
    means = 2.0 * places[:, :4] @ MAP
    return means[:, None] + 2.0 * rng.standard_normal((len(places), 2, NUMBERS))


@cache
def learnt(width: float, rigs: int, seed: int) -> Spread:
    """By simulated rigs 2.5 times as wide as usual, from `rigs` that are so many times as wide."""
    rng = np.random.default_rng([4, seed])
    moments, places = Moments(CELLS), rng.standard_normal((200, len(NAMES)))
    known = Rigs(NAMES, places, moments(shown(WIDE * places, rng)))
    measured = shown(width * rng.standard_normal((rigs, len(NAMES))), rng)
    with threadpool_limits(1, user_api="blas"):  # matrices too small for threads to pay
        return spread_among([(known, moments, blocks) for blocks in measured], 1 / WIDE)


@pytest.mark.parametrize("width", [1.0, 2.0, 4.0])
def test_a_common_width_is_found(width: float) -> None:
    found = [WIDE * learnt(width, 5, seed).common for seed in range(6)]
    # five rigs of four tolerances: 20 squares, a deviation known to 16 %, drawn a little towards 1
    assert np.median(found) == pytest.approx(width, rel=0.2)


def test_what_is_not_seen_is_as_wide_as_all_together() -> None:
    spread = learnt(2.0, 5, 0)
    assert spread.told[NAMES.index("not seen")] < 0.1
    assert min(spread.told[:4]) > 0.8
    assert spread.widths[NAMES.index("not seen")] == pytest.approx(spread.common, rel=0.15)


def test_one_that_is_wide_by_itself_is_found_from_many_rigs() -> None:
    rng = np.random.default_rng(9)
    moments, places = Moments(CELLS), rng.standard_normal((200, len(NAMES)))
    known = Rigs(NAMES, places, moments(shown(WIDE * places, rng)))
    measured = shown(rng.standard_normal((40, len(NAMES))) * [1, 4, 1, 1, 1], rng)
    with threadpool_limits(1, user_api="blas"):
        spread = spread_among([(known, moments, blocks) for blocks in measured], 1 / WIDE)
    widths = dict(zip(NAMES, WIDE * spread.widths, strict=True))
    assert widths["second"] > 2.5
    assert widths["first"] < 1.6
    assert np.mean(spread.off) == pytest.approx(1.0, abs=0.3)
