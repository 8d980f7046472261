"""Responses between simulated ones: Gaussian process regression of many outputs over few parameters.

Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), sections 2.2, 2.7 and 5.4.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_LENGTHS = (0.35, 0.7, 1.5, 4.0)
_NOISES = (0.003, 0.01, 0.03, 0.1, 0.3)
_TREND = 0.5
_LOCAL = 0.7
"""Standardised coordinates within which residuals tell how well an emulator does."""
_PRIOR_WEIGHT = 6.0
_OUTLIER = 30.0


@dataclass(frozen=True, slots=True)
class Emulator:
    """Mean response (outputs) at coordinates, and how uncertain it is in units of the responses' own scatter.

    `left_out` (n, outputs) is what each simulated response differs by from its prediction by the others.
    """

    centre: Array
    scale: Array
    lengths: Array
    noise: float
    known: Array
    weights: Array
    inverse: Array
    left_out: Array
    squares: Array

    def __call__(self, coordinates: Array) -> tuple[Array, Array, Array]:
        """Means (n, outputs), variances of the mean (n,) and of residuals nearby (n,); noise is 1."""
        x = (coordinates - self.centre) / self.scale
        kernel = _kernel(x, self.known, self.lengths)
        own = 1.0 + _TREND * (1 + np.sum(x**2, axis=1) / 4)
        variance = own - np.einsum("ij,jk,ik->i", kernel, self.inverse, kernel)
        near = np.exp(-0.5 * _distances(x, self.known, np.full(x.shape[1], _LOCAL)))
        local = (near @ self.squares + _PRIOR_WEIGHT) / (near.sum(axis=1) + _PRIOR_WEIGHT)
        return kernel @ self.weights, np.maximum(variance, 0.0) / self.noise, local


def fitted(coordinates: Array, responses: Array) -> Emulator:
    """Fit to `coordinates` (n, m) and `responses` (n, outputs) of about unit scatter; n of 4 at least.

    Lengths and noise are those that predict each response best from the others.
    """
    centre, scale = coordinates.mean(axis=0), coordinates.std(axis=0) + 1e-9
    x = (coordinates - centre) / scale
    lengths = np.full(x.shape[1], 1.5)
    best = _loss(x, responses, lengths)
    for _ in range(2 if x.shape[1] > 1 else 1):
        for k in range(x.shape[1]):
            for length in _LENGTHS:
                tried = lengths.copy()
                tried[k] = length
                found = _loss(x, responses, tried)
                if found[0] < best[0]:
                    best, lengths = found, tried
    _, noise, inverse, left_out = best
    squares = np.minimum(np.mean(left_out**2, axis=1), _OUTLIER)
    return Emulator(centre, scale, lengths, noise, x, inverse @ responses, inverse, left_out, squares)


def _loss(x: Array, responses: Array, lengths: Array) -> tuple[float, float, Array, Array]:
    """Mean square of what each response differs by from its prediction by the others, for the best noise."""
    kernel = _kernel(x, x, lengths)
    values, vectors = np.linalg.eigh(kernel)
    turned = vectors.T @ responses
    found = []
    for noise in _NOISES:
        weights = vectors @ (turned / (values + noise)[:, None])
        diagonal = (vectors**2) @ (1 / (values + noise))
        left_out = weights / diagonal[:, None]
        found.append((float(np.mean(np.minimum(left_out**2, _OUTLIER))), noise, left_out))
    loss, noise, left_out = min(found, key=lambda each: each[0])
    return loss, noise, vectors @ (vectors / (values + noise)).T, left_out


def _kernel(x: Array, y: Array, lengths: Array) -> Array:
    """A smooth function on a trend."""
    trend = 1 + x @ y.T / 4
    return np.asarray(np.exp(-0.5 * _distances(x, y, lengths)) + _TREND * trend)


def _distances(x: Array, y: Array, lengths: Array) -> Array:
    a, b = x / lengths, y / lengths
    squares = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1)[None] - 2 * a @ b.T
    return np.asarray(np.maximum(squares, 0.0))
