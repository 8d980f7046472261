"""Euler-Bernoulli beams by finite elements.

Cubic Hermite elements, consistent mass; degrees of freedom w, theta at each node.
Source: Przemieniecki, Theory of Matrix Structural Analysis (1968), chapters 5 and 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.ranges import require

Matrix = NDArray[np.float64]
_UNITS = {"E": "Pa", "rho": "kg/m3", "length": "m", "width": "m", "thickness": "m"}


@dataclass(frozen=True, slots=True)
class Beam:
    """A uniform straight beam in bending.

    `E` in Pa, `rho` in kg/m3, `length` L, `width` b and `thickness` h in m; `elements` of equal length.
    """

    E: float
    rho: float
    length: float
    width: float
    thickness: float
    elements: int

    def __post_init__(self) -> None:
        for name, unit in _UNITS.items():
            require("beam", name, getattr(self, name), 0.0, unit=unit, above=True)
        require("beam", "elements", self.elements, 1)

    @property
    def bending_stiffness(self) -> float:
        """E b h^3 / 12, N m2."""
        return self.E * self.width * self.thickness**3 / 12

    @property
    def mass_per_length(self) -> float:
        """rho b h, kg/m."""
        return self.rho * self.width * self.thickness

    def matrices(self) -> tuple[Matrix, Matrix]:
        """Mass and stiffness of the free beam, each of shape (2 (elements + 1), 2 (elements + 1)), SI."""
        me, ke = bending_matrices(self.bending_stiffness, self.mass_per_length, self.length / self.elements)
        size = 2 * (self.elements + 1)
        M, K = np.zeros((size, size)), np.zeros((size, size))
        for element in range(self.elements):
            span = slice(2 * element, 2 * element + 4)
            M[span, span] += me
            K[span, span] += ke
        return M, K

    def deflection_row(self, fraction: float) -> NDArray[np.float64]:
        """Row h with w(fraction L) = h . dofs, shape (2 (elements + 1),); `fraction` in 0..1."""
        le, element, s = self._within_element(fraction)
        shape = [1 - 3 * s**2 + 2 * s**3, le * (s - 2 * s**2 + s**3), 3 * s**2 - 2 * s**3, le * (s**3 - s**2)]
        return self._row(element, shape)

    def slope_row(self, fraction: float) -> NDArray[np.float64]:
        """Row h with w'(fraction L) = h . dofs, shape (2 (elements + 1),); `fraction` in 0..1."""
        le, element, s = self._within_element(fraction)
        shape = [6 * (s**2 - s) / le, 1 - 4 * s + 3 * s**2, 6 * (s - s**2) / le, 3 * s**2 - 2 * s]
        return self._row(element, shape)

    def _within_element(self, fraction: float) -> tuple[float, int, float]:
        element = min(int(fraction * self.elements), self.elements - 1)
        return self.length / self.elements, element, fraction * self.elements - element

    def _row(self, element: int, shape: list[float]) -> NDArray[np.float64]:
        row = np.zeros(2 * (self.elements + 1))
        row[2 * element : 2 * element + 4] = shape
        return row


def bending_matrices(EI: float, mass_per_length: float, length: float) -> tuple[Matrix, Matrix]:
    """Mass and stiffness (4, 4) of one element, dofs w, theta at both ends: EI in N m2, kg/m, m."""
    powers = _powers(length)
    return mass_per_length * length / 420 * _MASS * powers, EI / length**3 * _STIFFNESS * powers


_STIFFNESS = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]], dtype=float)
_MASS = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]], dtype=float)


def _powers(le: float) -> Matrix:
    scale = np.array([1.0, le, 1.0, le])
    return np.outer(scale, scale)
