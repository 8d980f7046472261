"""Recursive filters with memory: of any coefficients, of one mode, of an oscillator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LinearFilter:
    """A recursive filter of up to second order with memory; starts at rest."""

    def __init__(self, b: Array, a: Array) -> None:
        self._passes = len(a) == len(b) == 1
        self._b, self._a = (np.pad(each / a[0], (0, 3 - len(each))) for each in (b, a))
        self._state = np.zeros(2)

    def __call__(self, x: Array) -> Array:
        """Filter the next samples, shape (n,) to (n,)."""
        if self._passes:
            return x

        from sim_twin.decimation import second_order

        y = np.empty(len(x))
        second_order(self._b, self._a, np.ascontiguousarray(x, np.float64), self._state, y)
        return y


def oscillator(
    omega: float, decay: float, B: float, C: tuple[float, float], D: float, rate: float
) -> LinearFilter:
    """C (x, x') + D u of x'' + `decay` x' + `omega`^2 x = B u, exact for u that is linear between samples.

    By the exponential of motion, u and its slope together (Franklin, Powell and Workman, Digital Control of
    Dynamic Systems, 3rd edition, pages 204-206).
    """
    from scipy.linalg import expm

    together = np.zeros((4, 4))
    together[:2, :3] = np.array([[0.0, 1.0, 0.0], [-(omega**2), -decay, B]]) * (1 / rate)
    together[2, 3] = 1.0
    turn, row = expm(together), np.array([C])
    A, slope = turn[:2, :2], turn[:2, 3:]
    column, direct = turn[:2, 2:3] - slope + A @ slope, D + (row @ slope)[0, 0]
    denominator = np.asarray(np.poly(A), np.float64)
    return LinearFilter(np.poly(A - column @ row) + (direct - 1) * denominator, denominator)


def resonance(frequency: float, damping_ratio: float, rate: float) -> LinearFilter:
    """One mode, gain 1 at low frequency, exact for inputs that are linear between samples."""
    omega = 2 * np.pi * frequency
    return oscillator(omega, 2 * damping_ratio * omega, omega**2, (1.0, 0.0), 0.0, rate)
