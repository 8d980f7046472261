"""The space in which fingerprints are compared: a healthy rig's scatter is the unit in every direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from sim_twin.diagnosis.fingerprint import SLICES, Layout

Array = NDArray[np.float64]
_LINEAR_TO = 5.0
"""In healthy scatters: beyond it, distances count by their logarithm."""
_SPREAD = np.linspace(-0.5, 0.5, SLICES)


@dataclass(frozen=True)
class Moments:
    """Takes a fingerprint's distributions by their mean and their spread, and leaves other numbers alone."""

    layout: Layout

    def __call__(self, fingerprints: NDArray[np.floating]) -> Array:
        """From shape (..., numbers) to (..., features): means, spreads, others."""
        values = np.asarray(fingerprints, dtype=np.float64)
        of_distributions, of_others = self._places
        distributed = values[..., of_distributions]
        return np.concatenate(
            [distributed.mean(axis=-1), distributed @ _SPREAD, values[..., of_others]], axis=-1
        )

    @cached_property
    def tolerance(self) -> Array:
        """Of each feature, in its unit."""
        spread, alone = self._of_cells(np.array([cell.tolerance for cell in self.layout.cells]))
        return np.concatenate([spread, spread, alone])

    @cached_property
    def kinds(self) -> NDArray[np.intp]:
        """Which features go up and down together where programs differ: of one run, channel and figure."""
        names = [(cell.run, cell.channel, cell.what) for cell in self.layout.cells]
        numbers = {name: k for k, name in enumerate(dict.fromkeys(names))}
        spread, alone = self._of_cells(np.array([numbers[name] for name in names]))
        return np.concatenate([spread, spread + len(numbers), alone])

    def _of_cells(self, each: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """What is said of each cell, for each distribution and for each number of the others."""
        return each[self._distributed], np.repeat(each, np.where(self._distributed, 0, self._sizes))

    @cached_property
    def runs(self) -> NDArray[np.intp]:
        """Of which run each feature is."""
        spread, alone = self._of_cells(np.array([cell.run for cell in self.layout.cells], dtype=np.intp))
        return np.concatenate([spread, spread, alone])

    def of_run(self, run: int) -> Moments:
        """Of the fingerprints of one run alone."""
        return Moments(self.layout.only(lambda cell: cell.run == run)[0])

    def worth(self, told: Sequence[float], blocks: int) -> Array:
        """How many blocks each feature's run is worth, by what is `told` of the runs; else all `blocks`."""
        return np.asarray(told)[self.runs] if told else np.full(len(self.runs), float(blocks))

    @cached_property
    def _sizes(self) -> NDArray[np.intp]:
        return np.array([cell.size for cell in self.layout.cells], dtype=np.intp)

    @cached_property
    def _distributed(self) -> NDArray[np.bool_]:
        return np.array([cell.distribution for cell in self.layout.cells], dtype=bool)

    @cached_property
    def _places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Of the numbers of each distribution, (distributions, SLICES), and of all others."""
        starts = self.layout.starts[:-1][self._distributed]
        distributed = np.repeat(self._distributed, self._sizes)
        return np.asarray(starts[:, None] + np.arange(SLICES)), np.flatnonzero(~distributed)


@dataclass(frozen=True, slots=True)
class Space:
    """Directions in which effects or healthy rigs differ; the unit is about a healthy rig's scatter."""

    centre: Array
    scale: Array
    basis: Array

    def scaled(self, features: Array) -> Array:
        """Features about a healthy rig's, far ones by their logarithm, shape (..., features)."""
        x = (features - self.centre) / self.scale
        far = np.maximum(np.abs(x), _LINEAR_TO)
        return np.asarray(
            np.where(np.abs(x) > _LINEAR_TO, np.sign(x) * _LINEAR_TO * (1 + np.log(far / _LINEAR_TO)), x)
        )

    def __call__(self, features: Array) -> Array:
        """From shape (..., features) to (..., directions)."""
        return np.asarray(self.scaled(features) @ self.basis)

    def tolerated(self, moments: Moments) -> Array:
        """Covariance (directions, directions) of what two careful programs may differ by.

        One half of it each feature has for itself, the other all of one kind have together.
        """
        share = np.sqrt(0.5) * moments.tolerance / self.scale
        alone = (self.basis * share[:, None] ** 2).T @ self.basis
        common = np.zeros((moments.kinds.max() + 1, self.basis.shape[1]))
        np.add.at(common, moments.kinds, self.basis * share[:, None])
        return np.asarray(alone + common.T @ common)

    def outside(self, features: Array) -> Array:
        """Root mean square of what no direction holds, shape (...,)."""
        x = self.scaled(features)
        return np.asarray(np.sqrt(np.mean((x - x @ self.basis @ self.basis.T) ** 2, axis=-1)))


def space_of(healthy: Array, others: Array, tolerance: Array, directions: int) -> Space:
    """The space of some `healthy` fingerprints' features, shape (n, features), and those of `others`.

    Every fingerprint has the same say in the directions, however far it lies.
    """
    centre, deviation = healthy.mean(axis=0), healthy.std(axis=0)
    scale = np.hypot(1.25 * deviation, tolerance)
    scale[scale < 1e-9] = np.inf
    plain = Space(centre, scale, np.zeros((len(centre), 0)))
    x = plain.scaled(np.concatenate([healthy, others]))
    size = np.linalg.norm(x, axis=1, keepdims=True)
    x = x / np.maximum(size, np.sqrt(x.shape[1]))
    # right singular vectors of the largest singular values, by the smaller Gram matrix
    last = min(x.shape) - 1
    wanted = (max(0, last - directions + 1), last)
    if x.shape[0] >= x.shape[1]:
        _, vectors = eigh(x.T @ x, subset_by_index=wanted)
    else:
        values, left = eigh(x @ x.T, subset_by_index=wanted)
        vectors = x.T @ (left / np.sqrt(np.maximum(values, 1e-12)))
    return Space(centre, scale, np.asarray(vectors[:, ::-1]))
