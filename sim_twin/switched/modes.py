"""Complex modes of a linear system x' = A x."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_WORST_CONDITION = 1e10


class ComplexModes(NamedTuple):
    """x = Re(`shapes` s), s' = `rates` s, s = `left` x; of a conjugate pair one is kept, with weight two."""

    rates: NDArray[np.complex128]  # (mode,)
    shapes: NDArray[np.complex128]  # (state, mode)
    left: NDArray[np.complex128]  # (mode, state)


def complex_modes(A: NDArray[np.float64]) -> ComplexModes:
    """Modes of A, shape (2 n, 2 n), which has the form [[0, 1], [-K, -C]] or is a projection of it."""
    rates, V = np.linalg.eig(A)
    if np.linalg.cond(V) > _WORST_CONDITION * np.linalg.norm(A):
        rates, V = np.linalg.eig(_moved(A))
    left = np.linalg.inv(V)
    keep = np.flatnonzero(rates.imag >= 0)
    weight = np.where(rates[keep].imag > 0, 2.0, 1.0)
    return ComplexModes(
        rates[keep].astype(complex), (V[:, keep] * weight).astype(complex), left[keep].astype(complex)
    )


def _moved(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """A with its damping moved by 1e-7, where a critically damped pair makes its modes coincide."""
    n = len(A) // 2
    moved = A.copy()
    moved[n:, n:] *= 1 + 1e-7
    return moved
