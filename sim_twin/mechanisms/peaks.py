"""The largest force of a contact, within its steps and not only at their ends."""

from __future__ import annotations

from typing import Any

from sim_twin.mechanisms.dormand_prince import LATE, Rates, dense, set_dense
from sim_twin.mechanisms.generic import generic, mechanical
from sim_twin.mechanisms.run import PEAK, Run

_LOOKS = 3
_LOOSE, _EDGE, _NEAR = 0.2, 0.1, 0.02
"""Fractions of a step: how far outside it a stage may show a summit that is looked for; where, then, at the
least from its ends; and the advance that ends the search."""


@generic
def follow_peaks(rates: Rates, p: Any, run: Run, t: float, h: float) -> None:
    """Raise the peaks of the contacts to the largest force in the step of `h` s, which is not yet accepted.

    A force of one of its stages tells whether it has a summit; the dense output then tells where.
    """
    for j in range(run.latched.size):
        if run.latched[j] == 0.0:
            continue
        peak = max(run.open_episode[j, PEAK], run.force[j], run.new_force[j])
        x, top = summit(run.force[j], LATE, run.late_force[j], run.new_force[j])
        if -_LOOSE < x < 1.0 + _LOOSE and top > peak:
            set_dense(run, h)
            peak = max(peak, _highest(rates, p, run, t, h, j, min(max(x, _EDGE), 1.0 - _EDGE)))
        run.open_episode[j, PEAK] = peak


@generic
def _highest(rates: Rates, p: Any, run: Run, t: float, h: float, j: int, x: float) -> float:
    """Largest force found from the fraction `x` of the step on, each look at the parabola's new summit."""
    highest = 0.0
    for _ in range(_LOOKS):
        dense(run.dense, x, run.between)
        # The second slope of a step is not needed any more.
        rates(p, t + x * h, run.between, run.latched, run.slopes[1], run.sought_force)
        highest = max(highest, run.sought_force[j])
        before = x
        x, _top = summit(run.force[j], x, run.sought_force[j], run.new_force[j])
        if not 0.0 < x < 1.0 or abs(x - before) < _NEAR:
            break
    return highest


@mechanical
def summit(y0: float, x: float, y: float, y1: float) -> tuple[float, float]:
    """Where the parabola through (0, y0), (x, y), (1, y1) is highest, and how high; -1 if it is not."""
    rise, chord = (y - y0) / x, y1 - y0
    bend = (chord - rise) / (1.0 - x)
    slope = chord - bend
    if bend >= 0.0:
        return -1.0, 0.0
    return -0.5 * slope / bend, y0 - 0.25 * slope * slope / bend
