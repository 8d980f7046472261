"""Rms and peak of cycles in one pass, however their samples come."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.signals.cycles import cycle_figures
from daq.signals.running_figures import CycleScanner
from daq.signals.turns import drive_turns
from tests.daq.signals.cuts import blocks, cuts_of

COUNT = 200


def scanned(values: np.ndarray, begins: np.ndarray, cuts: list[int]) -> np.ndarray:
    scanner = CycleScanner()
    found = []
    for block in blocks(len(values), cuts):
        inside = begins[(begins >= block.start) & (begins < block.stop)]
        found.append(scanner.add(values[block], inside - block.start))
    return np.concatenate(found) if found else np.empty((0, 2))


def test_a_sine_has_its_rms_and_its_amplitude() -> None:
    values = (3.0 * np.sin(2 * np.pi * np.arange(4000) / 1000)).astype(np.float32)
    rows = scanned(values, np.array([0, 1000, 2000, 3000]), [])
    # Samples of float32 are off by 6e-8 of their size; 1000 samples a cycle hit the crest.
    np.testing.assert_allclose(rows[1:], np.tile([3.0 / np.sqrt(2), 3.0], (3, 1)), rtol=1e-6)
    assert np.isnan(rows[0]).all()


def test_a_peak_is_the_largest_magnitude_on_either_side() -> None:
    values = np.array([1, -7, 2, 4, 3, -1, 0, 0], np.float32)
    rows = scanned(values, np.array([0, 3, 7]), [])
    np.testing.assert_array_equal(rows[1:, 1], [7.0, 4.0])


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**31), cuts_of(COUNT), st.lists(st.integers(0, COUNT - 1), unique=True))
def test_cuts_leave_no_trace(seed: int, cuts: list[int], begins: list[int]) -> None:
    values = np.random.default_rng(seed).normal(size=COUNT).astype(np.float32)
    at = np.array(sorted(begins), dtype=np.int64)
    np.testing.assert_array_equal(scanned(values, at, cuts), scanned(values, at, []))


def test_it_finds_what_the_meter_of_whole_records_finds() -> None:
    values = np.random.default_rng(5).normal(size=10_000).astype(np.float32)
    turns = drive_turns(len(values), 1000.0, 3.7)
    meter = cycle_figures(values, turns)
    begins = np.flatnonzero(np.diff(np.floor(turns), prepend=-1.0))
    rows = scanned(values, begins, [])[1:]
    # Both add some 270 squares, in another order: a rounding each.
    np.testing.assert_allclose(rows[:, 0], meter.rms[: len(rows)], rtol=300 * np.finfo(float).eps)
    np.testing.assert_array_equal(rows[:, 1], meter.peak[: len(rows)])


def test_what_is_spoilt_or_not_finite_has_no_figures_and_leaves_the_next_alone() -> None:
    values = np.ones(40, np.float32)
    values[15] = np.nan
    scanner = CycleScanner()
    rows = [scanner.add(values[:25], np.array([10, 20]))]
    scanner.spoil()
    rows.append(scanner.add(values[25:], np.array([5, 10])))
    assert np.isnan(np.concatenate(rows)).all(axis=1).tolist() == [False, True, True, False]
