"""How far a recording lies from an ensemble, in units of how far the ensemble's members lie apart."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Table: TypeAlias = NDArray[np.float64]
"""Rows are cycles, columns are features."""

_LEAST_SPREAD = 5e-3
"""Of a feature's mean: what varies less is rounding."""
_LEAST_DISTANCE = 0.02
"""In standard deviations: a tenth of what two members usually differ by."""


def energy_distances(one: Table, other: Table) -> NDArray[np.float64]:
    """Square root of the energy distance, 2 times the integral of (F - G)^2, for each column."""
    both = np.concatenate([one, other])
    weight = np.concatenate([np.full(len(one), 1 / len(one)), np.full(len(other), -1 / len(other))])
    order = np.argsort(both, axis=0, kind="stable")
    apart = np.cumsum(weight[order], axis=0)[:-1]
    steps = np.diff(np.take_along_axis(both, order, axis=0), axis=0)
    root: NDArray[np.float64] = np.sqrt(2 * np.sum(apart**2 * steps, axis=0))
    return root


class Floor:
    """The scale of a gap: how far healthy members with the hidden effects in them lie apart.

    `groups` numbers the group of each column. A gap is the rms over groups of the rms over their columns,
    divided by what it is for a member against the others: 1 means one more of them.
    """

    def __init__(self, members: Sequence[Table], groups: Sequence[int]) -> None:
        self._groups = np.asarray(groups)
        every = np.concatenate(list(members))
        scale = np.maximum(every.std(axis=0), _LEAST_SPREAD * np.abs(every.mean(axis=0)))
        self._scale = np.where(scale > 0, scale, 1.0)
        self._members = [member / self._scale for member in members]
        apart = {
            pair: energy_distances(self._members[pair[0]], self._members[pair[1]])
            for pair in combinations(range(len(members)), 2)
        }
        self._typical = np.mean(list(apart.values()), axis=0) + _LEAST_DISTANCE
        self.healthy = np.array([self._left_out(each, apart) for each in range(len(members))])
        self._one = float(np.median(self.healthy))

    def gap(self, recording: Table, ensemble: Sequence[Table]) -> float:
        """Gap between a recording and an ensemble."""
        row = recording / self._scale
        return self._rms([energy_distances(row, other / self._scale) for other in ensemble]) / self._one

    def _left_out(self, member: int, apart: dict[tuple[int, int], NDArray[np.float64]]) -> float:
        return self._rms([distance for pair, distance in apart.items() if member in pair])

    def _rms(self, distances: Sequence[NDArray[np.float64]]) -> float:
        ratio = np.mean(distances, axis=0) / self._typical
        groups = [np.mean(ratio[self._groups == group] ** 2) for group in np.unique(self._groups)]
        return float(np.sqrt(np.mean(groups)))
