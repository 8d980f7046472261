"""Means over many half cycles, which is all that can be said of the motion once chaos has acted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daq.signals.impacts import HalfCycles, half_cycles
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from tests.sim_twin.solver import RATE, driven

HALF_CYCLES = 1000

# Drive in Hz, clearance in mm; mean and deviation of the first and of the largest peak of a half cycle, N.
REFERENCE = [
    (5, 0.127, 23.07, 1.6, 29.51, 3.5),
    (5, 0.508, 68.65, 2.3, 91.92, 4.1),
    (20, 0.127, 34.86, 7.0, 39.57, 5.8),
    (20, 0.254, 62.50, 11.3, 70.32, 9.6),
    (20, 0.508, 88.59, 22.0, 98.80, 19.6),
]


@cache
def statistics(frequency: float, g_mm: float, damping: float = 0.01) -> HalfCycles:
    """Half cycles of the solver's force after the first second."""
    rig = replace(nominal(damping=damping), clearance=g_mm * 1e-3)
    simulation = driven(rig, SineDrive(9.0, frequency), orders=(1,))
    simulation.advance(round(RATE))
    outputs = simulation.advance(round(HALF_CYCLES / 2 / frequency * RATE)).outputs
    return half_cycles(outputs[0], outputs[1], RATE)


@pytest.mark.parametrize(("frequency", "g_mm", "first", "_", "largest", "__"), REFERENCE)
def test_means_of_first_and_largest_peak(
    frequency: float, g_mm: float, first: float, _: float, largest: float, __: float
) -> None:
    found = statistics(frequency, g_mm)
    assert len(found) >= 900
    # 5 % is what is asked; the standard error of 1,000 half cycles is 0.8 % at most.
    assert found.first_n.mean() == pytest.approx(first, rel=0.03)
    assert found.max_n.mean() == pytest.approx(largest, rel=0.03)


@pytest.mark.parametrize(("frequency", "g_mm", "_", "first", "__", "largest"), REFERENCE)
def test_deviations_of_first_and_largest_peak(
    frequency: float, g_mm: float, _: float, first: float, __: float, largest: float
) -> None:
    found = statistics(frequency, g_mm)
    # Successive half cycles are alike, so a deviation is known to some 5 %; 20 % for two of either kind.
    assert found.first_n.std() == pytest.approx(first, rel=0.2)
    assert found.max_n.std() == pytest.approx(largest, rel=0.2)


def test_sides_take_turns_and_are_alike() -> None:
    found = statistics(20, 0.127)
    assert np.all(found.side[1:] == -found.side[:-1])
    upper, lower = found.max_n[found.side > 0], found.max_n[found.side < 0]
    assert upper.mean() == pytest.approx(lower.mean(), rel=0.04)  # 500 each: 0.7 % at one sigma


def test_two_runs_part_within_a_second_at_1_percent_damping_and_never_at_3() -> None:
    apart = {}
    for damping in (0.01, 0.03):
        rig = nominal(damping=damping)
        outputs = []
        for clearance in (rig.clearance, rig.clearance + 1e-9):
            simulation = driven(replace(rig, clearance=clearance), SineDrive(9.0, 5.0), orders=(1,))
            outputs.append(simulation.advance(2 * round(RATE)).outputs[0])
        apart[damping] = np.abs(np.diff(outputs, axis=0))[0, round(RATE) :].max()
    assert apart[0.01] > 5.0
    # In periodic motion a 1e-9 m wider gap shifts the impacts by some 10 ns: k v dt = 0.05 N.
    assert apart[0.03] < 0.5
