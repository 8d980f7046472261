"""A line through points of several segments: one slope, a level for each, the pull of outliers bounded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TUNING = 1.345
"""Huber's constant: 95 % of least squares' efficiency where the noise is normal."""
_MAD_TO_SIGMA = 1.4826
_FIRST, _ITERATIONS = 8, 60
_SMALLEST = 1e-13
"""A scale in s below which points count as exactly on the line: the rounding of seconds held in floats."""


@dataclass(frozen=True, slots=True)
class Line:
    """y = levels[segment] + slope x, with `extra` coefficients of further columns.

    `covariance` has the order of `coefficients`: the levels, the slope, then the extra columns.
    """

    coefficients: Array
    covariance: Array
    segments: int
    degrees_of_freedom: int

    @property
    def levels(self) -> Array:
        """Level of each segment at x = 0, shape (segments,)."""
        return self.coefficients[: self.segments]

    @property
    def slope(self) -> float:
        """The slope that all segments share."""
        return float(self.coefficients[self.segments])


def robust_line(x: Array, y: Array, segment: NDArray[np.intp], weight: Array, *extra: Array) -> Line:
    """Huber's M-estimate of a `Line` through points of shape (n,), n above the number of coefficients.

    `segment` numbers each point's segment from 0 without holes; `weight` is inverse to each point's
    deviation. The covariance is Huber's, with his correction for few points (Robust Statistics, 1981, 7.6).
    """
    segments = int(segment[-1]) + 1
    levels = (segment[:, None] == np.arange(segments)).astype(np.float64)
    scale = np.max(np.abs(x)) or 1.0
    design = weight[:, None] * np.column_stack([levels, x / scale, *extra])
    target = weight * y
    count, unknowns = design.shape
    coefficients, sigma = _iterate(design, target)
    psi = np.clip((target - design @ coefficients) / sigma, -_TUNING, _TUNING)
    inside = max(float(np.mean(np.abs(psi) < _TUNING)), 0.1)
    correction = 1 + unknowns / count * (1 - inside) / inside
    variance = (correction * sigma / inside) ** 2 * float(psi @ psi) / (count - unknowns)
    units = np.ones(unknowns)
    units[segments] = 1 / scale
    covariance = variance * np.linalg.pinv(design.T @ design) * np.outer(units, units)
    return Line(coefficients * units, covariance, segments, count - unknowns)


def _iterate(design: Array, target: Array) -> tuple[Array, float]:
    """Coefficients and scale: from least absolute deviations, which no outlier starts wrong, to Huber's."""
    count, unknowns = design.shape
    factor = np.ones(count)
    coefficients: Array = np.zeros(unknowns)
    sigma = _SMALLEST
    for step in range(_ITERATIONS):
        root = np.sqrt(factor)
        before = coefficients
        coefficients = np.asarray(np.linalg.lstsq(design * root[:, None], target * root, rcond=None)[0])
        distance = np.abs(target - design @ coefficients)
        spread = _MAD_TO_SIGMA * float(np.median(distance)) * np.sqrt(count / (count - unknowns))
        sigma = max(spread, _SMALLEST)
        if step < _FIRST:
            factor = sigma / np.maximum(distance, 1e-3 * sigma)
        else:
            factor = np.minimum(1.0, _TUNING * sigma / np.maximum(distance, _SMALLEST))
            if np.max(np.abs(coefficients - before)) < 1e-6 * sigma:
                break
    return coefficients, sigma
