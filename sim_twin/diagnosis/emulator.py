"""Responses between simulated ones: Gaussian process regression of many outputs over few parameters.

Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), sections 2.2, 2.7 and 5.4.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_LENGTHS = (4.0, 1.5, 0.7, 0.35, 0.2, 0.1, 0.05)
_NOISES = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
_LEAST_NOISE = 1e-3
_TREND = 0.5
_LOCAL = 0.7
"""Standardised coordinates within which residuals tell how well an emulator does."""
_PRIOR_WEIGHT = 6.0
_OUTLIER = 30.0
_UNIFORM_SHARE = 0.5
"""Of what is believed of an output's residuals, by those of all outputs; few residuals tell little of one."""


@dataclass(frozen=True, slots=True)
class Emulator:
    """Mean responses at coordinates, and how uncertain they are in units of the responses' own scatter, 1.

    Every output has its own ratio of noise to response. The kernel's eigenvalues are `values`, its
    eigenvectors `vectors`. `left_out` (n, outputs) is what each simulated response differs by from its
    prediction by the others.
    """

    centre: Array
    scale: Array
    lengths: Array
    known: Array
    weights: Array
    noises: Array
    values: Array
    vectors: Array
    left_out: Array

    def __call__(self, coordinates: Array) -> tuple[Array, Array]:
        """Means and excess variances at coordinates (n, m), both (n, outputs).

        The excess is the mean's own variance, and what residuals nearby have beyond a scatter of 1.
        """
        x = (coordinates - self.centre) / self.scale
        kernel = _kernel(x, self.known, self.lengths)
        near = np.exp(-0.5 * _distances(x, self.known, np.full(x.shape[1], _LOCAL)))
        residuals = np.minimum(self.left_out**2, _OUTLIER)
        residuals = (1 - _UNIFORM_SHARE) * residuals + _UNIFORM_SHARE * residuals.mean(axis=1, keepdims=True)
        local = (near @ residuals + _PRIOR_WEIGHT) / (near.sum(axis=1, keepdims=True) + _PRIOR_WEIGHT)
        excess = np.maximum(local - 1.0, 0.0)
        own = 1.0 + _TREND * (1 + np.sum(x**2, axis=1) / 4)
        squares = (kernel @ self.vectors) ** 2
        for noise in np.unique(self.noises):
            variance = np.maximum(own - squares @ (1 / (self.values + noise)), 0.0)
            excess[:, self.noises == noise] += (variance / max(noise, _LEAST_NOISE))[:, None]
        return kernel @ self.weights, excess


def fitted(coordinates: Array, responses: Array, lengths: Array | None = None) -> Emulator:
    """Fit to `coordinates` (n, m) and `responses` (n, outputs) of about unit scatter; n of 4 at least.

    Lengths (where none are given) and noises are those that predict each response best from the others; a
    shorter length has to do so by more than one standard error (Hastie et al., The Elements of Statistical
    Learning, 2009, section 7.10): over few rigs it does so by chance.
    """
    centre, scale = coordinates.mean(axis=0), coordinates.std(axis=0) + 1e-9
    x = (coordinates - centre) / scale
    lengths = _lengths(x, responses) if lengths is None else lengths
    best = _left_out(x, responses, lengths)
    turned = (best.vectors.T @ responses) / (best.values[:, None] + best.noises)
    weights = best.vectors @ turned
    return Emulator(
        centre, scale, lengths, x, weights, best.noises, best.values, best.vectors, best.residuals
    )


def _lengths(x: Array, responses: Array) -> Array:
    lengths = np.full(x.shape[1], _LENGTHS[0])
    best = _left_out(x, responses, lengths)
    for _ in range(2 if x.shape[1] > 1 else 1):
        for k in range(x.shape[1]):
            for length in _LENGTHS:
                tried = lengths.copy()
                tried[k] = length
                if np.array_equal(tried, lengths):
                    continue
                found = _left_out(x, responses, tried)
                less = best.losses - found.losses
                if less.mean() > less.std(ddof=1) / np.sqrt(len(less)):
                    best, lengths = found, tried
    return lengths


@dataclass(frozen=True, slots=True)
class _Tried:
    """One choice of lengths: the best noise of each output, and what is left then."""

    values: Array
    vectors: Array
    noises: Array
    residuals: Array

    @property
    def losses(self) -> Array:
        """Of each response, shape (n,)."""
        return np.asarray(np.minimum(self.residuals**2, _OUTLIER).mean(axis=1))


def _left_out(x: Array, responses: Array, lengths: Array) -> _Tried:
    """What each response differs by from its prediction by the others."""
    values, vectors = np.linalg.eigh(_kernel(x, x, lengths))
    turned = vectors.T @ responses
    residuals = np.empty((len(_NOISES), *responses.shape))
    for k, noise in enumerate(_NOISES):
        diagonal = (vectors**2) @ (1 / (values + noise))
        residuals[k] = vectors @ (turned / (values + noise)[:, None]) / diagonal[:, None]
    best = np.argmin(np.mean(np.minimum(residuals**2, _OUTLIER), axis=1), axis=0)
    outputs = np.arange(responses.shape[1])
    return _Tried(values, vectors, np.array(_NOISES)[best], residuals[best, :, outputs].T)


def _kernel(x: Array, y: Array, lengths: Array) -> Array:
    """A smooth function on a trend."""
    trend = 1 + x @ y.T / 4
    return np.asarray(np.exp(-0.5 * _distances(x, y, lengths)) + _TREND * trend)


def _distances(x: Array, y: Array, lengths: Array) -> Array:
    a, b = x / lengths, y / lengths
    squares = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1)[None] - 2 * a @ b.T
    return np.asarray(np.maximum(squares, 0.0))
