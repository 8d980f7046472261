from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings

from daq.signals.even_angles import CycleAverage, SynchronousAverage, synchronous_average
from tests.daq.signals.cuts import blocks, cuts_of, drive_turns

POINTS = 4096
RATE = 20.0 * 4096.5  # no whole number of samples in a cycle of 20 Hz


def wave(turns: np.ndarray) -> np.ndarray:
    """One cycle with content up to the 60th harmonic."""
    angle = 2 * np.pi * turns
    return 1.0 + np.sin(angle) + 0.3 * np.cos(11 * angle + 0.5) + 0.1 * np.sin(60 * angle)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("points", [256, 5000])
def test_the_mean_cycle_is_the_wave(points: int) -> None:
    turns = drive_turns(40_000, RATE, 20.0, 0.7)
    found = synchronous_average(wave(turns), turns, points)
    assert found.cycles == 8
    # Ripple of the interpolation, 1e-4 of each amplitude.
    assert found.mean == pytest.approx(wave(np.arange(points) / points), abs=2e-4)


def test_noise_falls_with_the_root_of_the_number_of_cycles() -> None:
    most = 64
    turns = drive_turns(round(4096.5 * (most + 2)), RATE, 20.0)
    values = wave(turns) + np.random.default_rng(18).normal(size=len(turns))
    averages = {}
    for cycles in (1, 4, 16, most):
        part = slice(round(4096.5 * (cycles + 1.1)))
        averages[cycles] = synchronous_average(values[part], turns[part], POINTS)
        assert averages[cycles].cycles == cycles
    # Deviation of one cycle, from 64 x 4096 points: right to 0.15 %.
    single = rms(averages[most].standard_error) * np.sqrt(most)
    truth = wave(np.arange(POINTS) / POINTS)
    for cycles, average in averages.items():
        # Of 4096 points, of which interpolation leaves some 3700 independent, an rms is right to 1.2 %.
        assert rms(average.mean - truth) * np.sqrt(cycles) / single == pytest.approx(1.0, abs=0.05)
    # The filter takes a tenth of the band; what remains is white.
    assert 0.9 < single < 1.0


def test_the_standard_error_is_that_of_the_mean() -> None:
    offsets = np.array([1.0, 2.0, 4.0, 5.0])
    turns = drive_turns(600, 100.0, 1.0)
    # Cycles 1 to 4 differ by constants alone; neighbours blur into each other near their seams.
    values = np.concatenate(([0.0], offsets, [0.0]))[np.floor(turns).astype(int)]
    found = synchronous_average(values, turns, 100)
    inner = slice(30, 70)
    assert found.cycles == 4
    assert found.mean[inner] == pytest.approx(3.0, abs=1e-3)
    assert found.standard_error[inner] == pytest.approx(offsets.std(ddof=1) / 2, abs=1e-3)


def test_a_cycle_with_a_sample_that_does_not_count_is_left_out() -> None:
    turns = drive_turns(3000, 256.0, 1.0)
    values = wave(turns)
    values[900] = 1e6  # cycle 3
    values[2000] = np.nan  # cycle 7
    found = synchronous_average(values, turns, 256, np.arange(3000) == 900)
    assert found.cycles == 10 - 2
    assert found.mean == pytest.approx(wave(np.arange(256) / 256), abs=2e-4)


def test_one_cycle_has_no_standard_error_and_none_no_mean() -> None:
    turns = drive_turns(250, 100.0, 1.0, phase=0.1)
    one = synchronous_average(np.ones(250), turns, 50)
    assert one.cycles == 1
    assert one.mean == pytest.approx(1.0, rel=1e-12)
    assert np.isnan(one.standard_error).all()
    none = synchronous_average(np.ones(90), turns[:90], 50)
    assert none.cycles == 0
    assert np.isnan(none.mean).all()


SHORT = 1500
TURNS = drive_turns(SHORT, 97.3, 1.0, 0.4)
VALUES = np.random.default_rng(19).normal(size=(2, SHORT)).astype(np.float32)
VALUES[1, 500] = np.nan


def same(found: SynchronousAverage, expected: SynchronousAverage) -> bool:
    pairs = (found.mean, expected.mean), (found.standard_error, expected.standard_error)
    return all(np.array_equal(one, other, equal_nan=True) for one, other in pairs)


@cache
def whole_record() -> SynchronousAverage:
    return synchronous_average(VALUES, TURNS, 60)


@settings(deadline=None, max_examples=25)
@given(cuts_of(SHORT))
def test_blocks_of_any_size_give_the_mean_cycle_of_the_whole(cuts: list[int]) -> None:
    average = CycleAverage(60)
    for block in blocks(SHORT, cuts):
        average.add(VALUES[:, block], TURNS[block])
    whole = whole_record()
    assert same(average.result(), whole)
    assert average.result().cycles.tolist() == whole.cycles.tolist() == [14, 12]
