"""How far the healthy rigs of one lab differ, learnt from runs of several.

Places of tolerances are normal, and so is what is seen of them (see `matching`): the variances that make the
runs most likely come by expectation and maximisation (Dempster, Laird and Rubin 1977), each drawn towards a
common one, since few rigs tell little of a tolerance by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.matching import Rigs, Summary, summary_of
from sim_twin.diagnosis.space import Moments

Array = NDArray[np.float64]
_ROUNDS = 200
_DRAWN = 8.0
"""Rigs that the common width counts for against those that were measured."""
_USUAL = 2.0
"""Tolerances that the usual width counts for against those that are told."""
_WIDTHS = (0.3, 10.0)


@dataclass(frozen=True, slots=True)
class Spread:
    """Widths (n,) of the tolerances `names`, in their own deviations; the `common` one of those not told.

    `told` (n,) is the share of a tolerance's variance that the runs tell; `off` (runs,) how far each lies off
    for rigs as wide as these, 1 on average.
    """

    names: tuple[str, ...]
    widths: Array
    common: float
    told: Array
    off: Array


def spread_among(seen: Sequence[tuple[Rigs, Moments, NDArray[np.floating]]], usual: float = 1.0) -> Spread:
    """Learn from runs, each with simulated rigs of its scenario (places in deviations), of the same names.

    Its fingerprints have shape (blocks, numbers). `usual` is the width that is to be expected, in the
    deviations of the simulated rigs, which should be as wide as the runs.
    """
    names = seen[0][0].names
    runs = [summary_of(*each) for each in seen]
    variances, common = np.full(len(names), usual**2), usual**2
    told = np.zeros(len(names))
    for _ in range(_ROUNDS):
        squares, told = np.zeros(len(names)), np.zeros(len(names))
        for run in runs:
            covariance = np.linalg.inv(run.information + np.diag(1 / variances))
            mean = covariance @ run.pull
            squares += mean**2 + np.diag(covariance)
            told += (1 - np.diag(covariance) / variances) / len(runs)
        common = float((_USUAL * usual**2 + told @ squares / len(runs)) / (_USUAL + told.sum()))
        variances = (_DRAWN * common + squares) / (_DRAWN + len(runs))
        variances = np.clip(variances, (usual * _WIDTHS[0]) ** 2, (usual * _WIDTHS[1]) ** 2)
    off = np.array([_off(run, variances) for run in runs])
    return Spread(names, np.sqrt(variances), float(np.sqrt(common)), told, off)


def _off(run: Summary, variances: Array) -> float:
    """Mean square of what a run shows, in the scatter of rigs with such variances."""
    spread = run.slope @ np.diag(variances) @ run.slope.T + run.scatter
    return float(run.place @ np.linalg.solve(spread, run.place)) / len(run.place)
