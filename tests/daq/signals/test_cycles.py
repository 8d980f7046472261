from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings

from daq.signals.cycles import CycleFigures, CycleMeter, cycle_figures
from daq.signals.turns import angle_turns, drive_turns
from tests.daq.signals.cuts import blocks, cuts_of

RATE = 51_200.0


def test_figures_of_a_sine_whose_mean_and_amplitude_differ_from_cycle_to_cycle() -> None:
    turns = drive_turns(round(0.5 * RATE), RATE, 20.0)  # ten cycles of 2560 samples
    number = np.floor(turns)
    found = cycle_figures(number + (1 + number) * np.sin(2 * np.pi * turns), turns)
    cycle = np.arange(10)
    assert found.cycle.tolist() == cycle.tolist()
    assert found.samples.tolist() == [2560] * 10
    assert found.mean == pytest.approx(cycle, abs=1e-9)
    assert found.rms == pytest.approx(np.sqrt(cycle**2 + (1 + cycle) ** 2 / 2), rel=1e-9)
    assert found.maximum == pytest.approx(2 * cycle + 1, rel=1e-9)
    assert found.minimum == pytest.approx(-1.0, rel=1e-9)
    assert found.peak == pytest.approx(np.maximum(2 * cycle + 1, 1.0), rel=1e-9)


def test_cycles_that_the_ends_of_the_record_cut_are_left_out() -> None:
    turns = drive_turns(1000, 100.0, 1.0, phase=1.0)
    assert cycle_figures(np.ones(1000), turns).cycle.tolist() == list(range(1, 10))


def test_a_crank_that_rocks_back_stays_in_its_cycle() -> None:
    angle = 2 * np.pi * np.array([0.5, 0.9, 1.01, 0.99, 0.98, 1.2, 1.7, 2.1, 2.2])
    found = cycle_figures(np.arange(9.0), angle_turns(angle))
    assert found.cycle.tolist() == [1]
    assert found.samples.tolist() == [5]
    assert found.mean == pytest.approx([4.0], rel=1e-15)


def test_a_cycle_with_a_sample_that_does_not_count_has_no_figures() -> None:
    turns = drive_turns(50, 10.0, 1.0)
    values = np.ones(50)
    values[12] = np.inf
    flagged = np.arange(50) == 25
    turns[37] = np.nan
    found = cycle_figures(values, turns, flagged)
    assert np.isnan(found.rms).tolist() == [False, True, True, True, False]
    assert np.isnan(found.peak).tolist() == [False, True, True, True, False]


@pytest.mark.parametrize("turns", [np.empty(0), np.full(5, np.nan), np.array([0.0])])
def test_a_record_without_cycles_has_no_figures(turns: np.ndarray) -> None:
    assert len(cycle_figures(np.ones(len(turns)), turns)) == 0


SHORT = 600
TURNS = 0.2 + 0.01 * np.arange(SHORT) + 4e-5 * np.arange(SHORT) ** 2
TURNS[:7] = np.nan
VALUES = np.random.default_rng(20).normal(size=SHORT).astype(np.float32)
VALUES[222] = np.nan


@settings(deadline=None, max_examples=60)
@given(cuts_of(SHORT))
def test_blocks_of_any_size_give_the_figures_of_the_whole(cuts: list[int]) -> None:
    meter = CycleMeter()
    parts = [meter.add(VALUES[block], TURNS[block]) for block in blocks(SHORT, cuts)]
    parts.append(meter.finish())
    whole = cycle_figures(VALUES, TURNS)
    for field in fields(CycleFigures):
        found = np.concatenate([getattr(part, field.name) for part in parts])
        assert np.array_equal(found, getattr(whole, field.name), equal_nan=True)
    assert len(whole) == 19
