"""Frequency, amplitude and phase of a measured sine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_ITERATIONS = 12
_CONVERGED = 1e-12


@dataclass(frozen=True, slots=True)
class SineFit:
    """offset + amplitude sin(2 pi frequency t + phase), t = 0 at the first sample.

    `frequency` in Hz, `phase` in rad in [0, 2 pi); `amplitude`, `offset`, rms `residual` in the unit fitted.
    """

    frequency: float
    amplitude: float
    phase: float
    offset: float
    residual: float


def fit_sine(
    values: NDArray[np.floating], sample_rate: float, frequency: float, hold_frequency: bool = False
) -> SineFit:
    """Fit a sine to `values` (shape (n,)) by least squares, starting from `frequency` Hz.

    The four-parameter fit of IEEE 1057-2017, 4.8.2; the start must be right to about half a cycle over the
    record. The frequency stays as given with `hold_frequency`, and where the record is less than a cycle.
    """
    y = np.asarray(values, dtype=float)
    t = np.arange(len(y)) / sample_rate
    omega = start = 2 * np.pi * frequency
    free = not hold_frequency and len(y) / sample_rate * frequency >= 1
    s, c, offset = _linear_fit(y, omega * t)
    for _ in range(_ITERATIONS if free else 0):
        sine, cosine = np.sin(omega * t), np.cos(omega * t)
        slope = t * (s * cosine - c * sine)
        solution = np.linalg.lstsq(np.column_stack([sine, cosine, np.ones_like(t), slope]), y)[0]
        step = float(np.clip(solution[3], -0.05 * start, 0.05 * start))
        s, c, omega = solution[0], solution[1], omega + step
        if abs(step) < _CONVERGED * omega:
            break
    s, c, offset = _linear_fit(y, omega * t)
    residual = y - s * np.sin(omega * t) - c * np.cos(omega * t) - offset
    return SineFit(
        frequency=float(omega / (2 * np.pi)),
        amplitude=float(np.hypot(s, c)),
        phase=float(np.arctan2(c, s) % (2 * np.pi)),
        offset=float(offset),
        residual=float(np.sqrt(np.mean(residual**2))),
    )


def _linear_fit(y: NDArray[np.float64], angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sine, cosine and constant parts of y."""
    columns = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])
    return np.asarray(np.linalg.lstsq(columns, y)[0])
