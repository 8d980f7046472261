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
    values: NDArray[np.floating],
    sample_rate: float,
    frequency: float,
    hold_frequency: bool = False,
    harmonics: int = 1,
) -> SineFit:
    """Fit a sine to `values` (shape (n,)) by least squares, starting from `frequency` Hz.

    The four-parameter fit of IEEE 1057-2017, 4.8.2; the start must be right to about half a cycle over the
    record. The frequency stays as given with `hold_frequency`, and where the record is less than a cycle.
    With `harmonics` above 1 the sine may be distorted by that many orders (its own is the first), which a
    record of broken cycles would otherwise take for another frequency; the fit tells of the first.
    """
    y = np.asarray(values, dtype=float)
    t = np.arange(len(y)) / sample_rate
    omega = start = 2 * np.pi * frequency
    free = not hold_frequency and len(y) / sample_rate * frequency >= 1
    orders = np.arange(1, harmonics + 1)
    parts = np.linalg.lstsq(waves_of(omega * t, orders), y)[0]
    for _ in range(_ITERATIONS if free else 0):
        waves, slope = waves_of(omega * t, orders), np.zeros_like(t)
        for order in orders:
            sine, cosine = waves[:, 2 * order - 1], waves[:, 2 * order]
            slope += order * t * (parts[2 * order - 1] * cosine - parts[2 * order] * sine)
        solution = np.linalg.lstsq(np.column_stack([waves, slope]), y)[0]
        step = float(np.clip(solution[-1], -0.05 * start, 0.05 * start))
        parts, omega = solution[:-1], omega + step
        if abs(step) < _CONVERGED * omega:
            break
    waves = waves_of(omega * t, orders)
    parts = np.linalg.lstsq(waves, y)[0]
    return SineFit(
        frequency=float(omega / (2 * np.pi)),
        amplitude=float(np.hypot(parts[1], parts[2])),
        phase=float(np.arctan2(parts[2], parts[1]) % (2 * np.pi)),
        offset=float(parts[0]),
        residual=float(np.sqrt(np.mean((y - waves @ parts) ** 2))),
    )


def fit_growing(
    values: NDArray[np.floating], sample_rate: float, frequency: float, cycles: float, harmonics: int = 1
) -> SineFit:
    """Fit a long record from its first `cycles` on, so that no start is off by more than part of a cycle."""
    start = frequency
    while True:
        count = min(len(values), int(cycles * sample_rate / start))
        fit = fit_sine(values[:count], sample_rate, frequency, harmonics=harmonics)
        if count == len(values):
            return fit
        frequency, cycles = fit.frequency, 2 * cycles


def waves_of(angle: NDArray[np.float64], orders: NDArray[np.intp]) -> NDArray[np.float64]:
    """What a fit is made of at `angle` (rad, shape (n,)): a constant, then sine and cosine of each order.

    Shape (n, 1 + 2 orders).
    """
    waves = [wave(order * angle) for order in orders for wave in (np.sin, np.cos)]
    return np.column_stack([np.ones_like(angle), *waves])
