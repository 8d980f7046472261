import re
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings

from daq.errors import UnphysicalParameter
from daq.signals.even_angles import AngleSampler, EvenAngles, to_even_angles
from tests.daq.signals.cuts import blocks, cuts_of

RATE = 4096.0
TIMES = np.arange(round(4 * RATE)) / RATE
RUN_UP = 5 * TIMES + 2.5 * TIMES**2  # turns: 300 to 1500 rpm within 4 s
WITHIN = 2e-4
"""Ripple of an 80 dB Kaiser window in the pass band, and what it lets through of images."""


def orders(turns: np.ndarray) -> np.ndarray:
    """Content up to the 25th order."""
    angle = 2 * np.pi * turns
    low = np.cos(angle + 0.3) + 0.5 * np.cos(3 * angle)
    return low + 0.2 * np.sin(7.5 * angle) + 0.1 * np.cos(25 * angle)


@pytest.mark.parametrize("points", [64, 256, 1024])
def test_values_at_even_angles_of_a_run_up(points: int) -> None:
    # From 13 samples an angle down to 1/6: the kernel is stretched here and not there.
    found = to_even_angles(orders(RUN_UP), RUN_UP, points)
    turns = (found.first + np.arange(len(found.values))) / points
    assert turns[0] < 1.5
    assert turns[-1] > RUN_UP[-1] - 25 / points - 0.2
    assert np.abs(found.values - orders(turns)).max() < WITHIN * 1.8  # sum of the amplitudes


def test_content_above_the_grid_does_not_come_back_as_an_alias() -> None:
    turns = 4.0 * TIMES + 0.123
    found = to_even_angles(np.cos(2 * np.pi * 37 * turns), turns, 64)  # 37 > 0.56 x 64
    assert np.abs(found.values).max() < WITHIN
    kept = to_even_angles(np.cos(2 * np.pi * 28 * turns), turns, 64)  # 28 = 0.4375 x 64
    assert np.abs(kept.values).max() == pytest.approx(1.0, abs=WITHIN)


def test_a_constant_stays_a_constant() -> None:
    assert to_even_angles(np.full(len(TIMES), 7.0), RUN_UP, 100).values == pytest.approx(7.0, rel=1e-12)


def test_channels_share_their_angles() -> None:
    both = np.stack((orders(RUN_UP), TIMES))
    found = to_even_angles(both, RUN_UP, 64)
    for channel, values in zip(both, found.values, strict=True):
        assert np.array_equal(values, to_even_angles(channel, RUN_UP, 64).values)


def test_samples_that_do_not_count_leave_a_hole_and_no_trace() -> None:
    turns = 8.0 * TIMES
    values = orders(turns)
    clean = to_even_angles(values, turns, 512)  # one angle a sample
    values[5000] = 1e9
    turns[9000] = np.nan
    found = to_even_angles(values, turns, 512, np.arange(len(turns)) == 5000)
    hole = np.isnan(found.values)
    at = found.first + np.flatnonzero(hole)
    # The kernel reaches 24 samples to each side of it.
    assert at.min() >= 4975
    assert at.max() <= 9026
    assert 2 <= hole.sum() <= 100
    assert np.array_equal(found.values[~hole], clean.values[~hole])


def test_an_angle_that_is_passed_again_counts_once() -> None:
    there, on = np.linspace(0.05, 2.05, 2000), 2.05 + np.linspace(0.001, 1.0, 1000)
    turns = np.concatenate((there, there[::-1][:500], there[-500:], on))
    found = to_even_angles(np.ones(len(turns)), turns, 100)
    # Up to turn 3.05, less the reach of the filter; counted twice, half a turn more.
    assert found.first + len(found.values) == pytest.approx(305 - 25, abs=1)


def test_the_last_angle_before_a_standstill_comes_out() -> None:
    turns = np.concatenate((0.005 * np.arange(1000), np.full(2000, 4.995)))
    found = to_even_angles(np.ones(3000), turns, 20)
    assert found.first + len(found.values) - 1 == 99  # turn 4.95
    assert found.values == pytest.approx(1.0, rel=1e-12)


def test_an_angle_that_leaps_is_refused() -> None:
    turns = np.array([0.0, 0.1, 0.2, 0.8])
    text = "angular resampling: turns from sample to sample = 0.6: at most 0.5"
    with pytest.raises(UnphysicalParameter, match=re.escape(text)):
        AngleSampler(10).add(np.zeros(4), turns)
    with pytest.raises(UnphysicalParameter, match="points a turn = 0: at least 1"):
        AngleSampler(0)


def test_without_an_angle_there_are_no_values() -> None:
    assert len(to_even_angles(np.ones(100), np.full(100, np.nan), 10).values) == 0


SHORT = 1000
TURNS = 0.3 + 4e-3 * np.arange(SHORT) + 5e-5 * np.arange(SHORT) ** 2
TURNS[:50] = np.nan
TURNS[900:902] = np.nan
TURNS[700:705] = TURNS[700]  # a standstill
VALUES = np.random.default_rng(16).normal(size=(2, SHORT))
VALUES[0, 600] = np.nan


@cache
def whole_record() -> EvenAngles:
    return AngleSampler(32).add(VALUES, TURNS)


@settings(deadline=None, max_examples=25)
@given(cuts_of(SHORT))
def test_blocks_of_any_size_give_the_values_of_the_whole(cuts: list[int]) -> None:
    whole = whole_record()
    sampler = AngleSampler(32)
    parts = [sampler.add(VALUES[:, block], TURNS[block]) for block in blocks(SHORT, cuts)]
    found = np.concatenate([part.values for part in parts], axis=1)
    assert np.array_equal(found, whole.values, equal_nan=True)
    filled = [part for part in parts if part.values.size]
    assert filled[0].first == whole.first
    assert whole.values.shape[1] > 1500
