"""The space in which fingerprints are compared: a healthy rig's scatter is the unit in every direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from sim_twin.diagnosis.fingerprint.layout import SLICES, Layout

Array = NDArray[np.float64]
_LINEAR_TO = 5.0
"""In healthy scatters: beyond it, distances count by their logarithm."""
_TOLERANCE = {"energy": 0.05, "rms": 0.05, "peak": 0.02, "crest": 0.02, "coherence": 0.01, "quadrature": 0.01}
"""What two careful programs may differ by in the same motion; logarithms of energies and amplitudes."""
_SPREAD = np.linspace(-0.5, 0.5, SLICES)


@dataclass(frozen=True, slots=True)
class Moments:
    """Takes a fingerprint's distributions by their mean and their spread, and leaves other numbers alone."""

    layout: Layout

    def __call__(self, fingerprints: NDArray[np.floating]) -> Array:
        """From shape (..., numbers) to (..., features): means, spreads, others."""
        values = np.asarray(fingerprints, dtype=np.float64)
        picked = values[..., self._distributed()]
        return np.concatenate([picked.mean(axis=-1), picked @ _SPREAD, values[..., self._single()]], axis=-1)

    def _distributed(self) -> NDArray[np.intp]:
        chosen = np.array([cell.size == SLICES for cell in self.layout.cells])
        return np.asarray(self.layout.starts[:-1][chosen][:, None] + np.arange(SLICES))

    def _single(self) -> NDArray[np.intp]:
        cells, starts = self.layout.cells, self.layout.starts
        alone = [np.arange(starts[k], starts[k + 1]) for k, cell in enumerate(cells) if cell.size != SLICES]
        return np.concatenate([np.zeros(0, np.intp), *alone])

    @property
    def tolerance(self) -> Array:
        """Of each feature, in its unit."""
        spread = [_TOLERANCE.get(cell.what, 0.0) for cell in self.layout.cells if cell.size == SLICES]
        alone = [
            _TOLERANCE.get(cell.what, 0.0)
            for cell in self.layout.cells
            if cell.size != SLICES
            for _ in range(cell.size)
        ]
        return np.array([*spread, *spread, *alone])


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
    return Space(centre, scale, _main_directions(x / np.maximum(size, np.sqrt(x.shape[1])), directions))


def _main_directions(x: Array, count: int) -> Array:
    """Right singular vectors of the largest singular values, shape (features, count); by a Gram matrix."""
    if x.shape[0] >= x.shape[1]:
        last = x.shape[1] - 1
        _, vectors = eigh(x.T @ x, subset_by_index=(last - count + 1, last))
        return np.asarray(vectors[:, ::-1])
    last = x.shape[0] - 1
    values, vectors = eigh(x @ x.T, subset_by_index=(last - count + 1, last))
    return np.asarray((x.T @ (vectors / np.sqrt(np.maximum(values, 1e-12))))[:, ::-1])
