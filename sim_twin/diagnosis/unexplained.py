"""What the best hypothesis leaves: rigs simulated just as it says, held against the measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.gap import GapMeasure

Array = NDArray[np.float64]
_MISFIT, _OUTSIDE, _GAP = (np.log(0.45), 0.6), (np.log(0.92), 0.15), (np.log(0.85), 0.3)
"""Means and deviations of the three figures' logarithms where the catalogue holds the truth."""
_LEAST = -0.5
"""So that one figure that is better than usual does not outweigh another that is bad."""
_DOUBTFUL, _SLOPE = 4.8, 1.2
"""Sum of what they are off by, in deviations, at which one believes as much as not; and how fast that turns.
All set by eye on development campaigns of another engine (`python -m benchmarks.blind make DIR`, seeds 901
and 23678)."""
_NEVER_LESS = 0.015
"""No fit of what is known rules out what is not."""


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What is left of a measurement.

    `misfit`: mean square in the directions in which effects differ, in the scatter of like rigs. `outside`:
    what lies in no such direction, `gap`: what is left of the gap, both over what nine in ten like rigs have.
    """

    misfit: float
    outside: float
    gap: float

    @property
    def unknown(self) -> float:
        """Probability that something outside the catalogue is there."""
        figures = ((self.misfit, _MISFIT), (self.outside, _OUTSIDE), (self.gap, _GAP))
        off = sum(max((np.log(max(x, 1e-3)) - mean) / deviation, _LEAST) for x, (mean, deviation) in figures)
        return float(max(1 / (1 + np.exp(-_SLOPE * (off - _DOUBTFUL))), _NEVER_LESS))


def unexplained(
    attribution: Attribution, measure: GapMeasure, like: Array, measured: NDArray[np.float32], healthy: bool
) -> Unexplained:
    """What rigs with the best hypothesis in leave of `measured` (blocks, numbers).

    `like` are fingerprints (n, numbers) of such rigs; `healthy` where the hypothesis is that nothing is
    missing.
    """
    places = attribution.place(like)
    mean, variance = places.mean(axis=0), places.var(axis=0, ddof=1)
    scatter = attribution.scatter + np.maximum(variance - 1, 0.0) + variance / len(like)
    misfit = np.mean((attribution.place(measured).mean(axis=0) - mean) ** 2 / scatter)
    twin = measure if healthy else measure.of_repaired(like)
    usual = np.percentile([twin.total(twin.cells(each[None])) for each in like], 90)
    gap = twin.total(twin.cells(measured)) / float(usual)
    return Unexplained(float(misfit), _outside(attribution, like, measured), gap)


def _outside(attribution: Attribution, like: Array, measured: NDArray[np.float32]) -> float:
    moments, space = attribution.moments, attribution.space
    if space.basis.shape[1] >= space.basis.shape[0]:
        return 0.0  # the directions hold everything
    there = np.percentile(space.outside(moments(like)), 90)
    return float(np.mean(space.outside(moments(measured))) / there)
