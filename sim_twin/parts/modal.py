"""Modal reduction of a structure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Modes:
    """Mass-normalised modes: `omega` (n,) in rad/s ascending, `shapes` (dofs, n) in kg^-1/2."""

    omega: NDArray[np.float64]
    shapes: Matrix


def lowest_modes(M: Matrix, K: Matrix, count: int) -> Modes:
    """Return the lowest `count` modes of M x'' + K x = 0 (rigid-body modes come out at omega = 0)."""
    squared, shapes = eigh(K, M, subset_by_index=(0, count - 1))
    return Modes(np.sqrt(np.maximum(squared, 0.0)), shapes)
