"""A straight beam of Euler-Bernoulli elements, as both engines with something elastic in them take it."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


def bending_matrices(length: float, stiffness: float, line_mass: float, elements: int) -> tuple[Array, Array]:
    """Free-free mass and stiffness; deflection (m) and rotation (rad) at each node in turn.

    `length` in m, bending `stiffness` E I in N m2, `line_mass` in kg/m.
    """
    h = length / elements
    scale = np.array([1, h, 1, h])
    units = np.outer(scale, scale)
    k = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]) * units
    m = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) * units
    M, K = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for i in range(0, 2 * elements, 2):
        M[i : i + 4, i : i + 4] += line_mass * h / 420 * m
        K[i : i + 4, i : i + 4] += stiffness / h**3 * k
    return M, K
