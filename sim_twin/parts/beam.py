"""Euler-Bernoulli beams by finite elements, and the exact modes of a slender round rod.

Beams: cubic Hermite elements, consistent mass; degrees of freedom w, theta at each node. Source:
Przemieniecki, Theory of Matrix Structural Analysis (1968), chapters 5 and 11.

The rod is pinned at one end and free at the other: tan(beta L) = tanh(beta L). The free end carries whatever
force acts there, so the modes are those of a force boundary. Source: Blevins, Formulas for Natural Frequency
and Mode Shape (1979), table 8-1, case pinned-free.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import Annotated

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import NDArray

from daq.quantity import Bound, Quantity
from sim_twin.parts.modal import Elastic
from sim_twin.parts.stuff import DENSITY, MODULUS
from sim_twin.ranges import require, require_bounds

Array = NDArray[np.float64]
MOST_BENDING_MODES = 12
"""In each plane; the next would bend within one diameter of a rod 30 diameters long."""


@dataclass(frozen=True, slots=True)
class Beam:
    """A uniform straight beam in bending.

    `E` in Pa, `rho` in kg/m3, `length` L, `width` b and `thickness` h in m; `elements` of equal length.
    """

    E: Annotated[float, MODULUS, Bound("Pa", 0.0, above=True)]
    rho: Annotated[float, DENSITY, Bound("kg/m3", 0.0, above=True)]
    length: Annotated[float, Quantity("mm", 10, 5000), Bound("m", 0.0, above=True)]
    width: Annotated[float, Quantity("mm", 0.1, 1000), Bound("m", 0.0, above=True)]
    thickness: Annotated[float, Quantity("mm", 0.1, 200), Bound("m", 0.0, above=True)]
    elements: Annotated[int, Bound("", 1)]

    def __post_init__(self) -> None:
        require_bounds("beam", self)

    @property
    def bending_stiffness(self) -> float:
        """E b h^3 / 12, N m2."""
        return self.E * self.width * self.thickness**3 / 12

    @property
    def mass_per_length(self) -> float:
        """rho b h, kg/m."""
        return self.rho * self.width * self.thickness

    def elastic(self) -> Elastic:
        """The free beam, by w and theta at each of its elements + 1 nodes."""
        own = bending(self.bending_stiffness, self.mass_per_length, self.length / self.elements)
        size = 2 * (self.elements + 1)
        M, B = np.zeros((size, size)), np.zeros((self.elements, len(own.B), size))
        for element in range(self.elements):
            span = slice(2 * element, 2 * element + 4)
            M[span, span] += own.M
            B[element, :, span] = own.B
        return Elastic(M, B.reshape(-1, size))

    def deflection_row(self, fraction: float) -> Array:
        """Row h with w(fraction L) = h . dofs, shape (2 (elements + 1),); `fraction` in 0..1."""
        return self._row(fraction, 0)

    def slope_row(self, fraction: float) -> Array:
        """Row h with w'(fraction L) = h . dofs, shape (2 (elements + 1),); `fraction` in 0..1."""
        return self._row(fraction, 1)

    def _row(self, fraction: float, derivative: int) -> Array:
        nodes = np.linspace(0.0, self.length, self.elements + 1)
        return np.asarray(hermite_rows(nodes, np.array([fraction * self.length]), derivative)[0])


def hermite_rows(nodes: Array, at: Array, derivative: int = 0) -> Array:
    """Rows of a piecewise cubic's `derivative` at the places `at`, shape (at, 2 nodes).

    Its degrees of freedom are value and slope at each of the ascending `nodes`; all in m.
    """
    element = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
    length = np.diff(nodes)[element]
    shapes = polyval((at - nodes[element]) / length, polyder(_HERMITE, derivative))
    shapes[1::2] *= length
    rows = np.zeros((len(at), 2 * len(nodes)))
    np.put_along_axis(rows, 2 * element[:, None] + np.arange(4), (shapes / length**derivative).T, axis=1)
    return rows


def bending(EI: float, mass_per_length: float, length: float) -> Elastic:
    """One element, dofs w, theta at both ends: EI in N m2, kg/m, m.

    It bends evenly by the difference of its slopes, and to an S by what these exceed those of its chord.
    """
    scale = np.array([1.0, length, 1.0, length])
    mass = mass_per_length * length / 420 * _MASS * np.outer(scale, scale)
    even = sqrt(EI / length) * np.array([0.0, -1.0, 0.0, 1.0])
    s_shaped = sqrt(3 * EI / length) * np.array([2.0 / length, 1.0, -2.0 / length, 1.0])
    return Elastic(mass, np.array([even, s_shaped]))


_HERMITE = np.array([[1, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]], dtype=float).T
"""Powers of s = 0..1 along an element, a column each: value and slope at its start, at its end."""
_MASS = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]], dtype=float)


@dataclass(frozen=True, slots=True)
class Rod:
    """`E` in Pa, `rho` in kg/m3, `diameter` and `length` in m."""

    E: Annotated[float, MODULUS, Bound("Pa", 0.0, above=True)] = 207e9
    rho: Annotated[float, DENSITY, Bound("kg/m3", 0.0, above=True)] = 7800.0
    diameter: Annotated[float, Quantity("mm", 0.5, 100), Bound("m", 0.0, above=True)] = 6.4e-3
    length: Annotated[float, Quantity("mm", 10, 5000), Bound("m", 0.0, above=True)] = 0.19

    def __post_init__(self) -> None:
        require_bounds("rod", self)

    @property
    def mass(self) -> float:
        """In kg."""
        return self.rho * pi / 4 * self.diameter**2 * self.length

    @property
    def bending_stiffness(self) -> float:
        """E I in N m2."""
        return self.E * pi / 64 * self.diameter**4


@dataclass(frozen=True, slots=True)
class BendingModes:
    """Mass-normalised modes of one plane: `omega` rad/s, `tip` phi(L) and `sway`, the integral of phi dm.

    Shape (n,) each; tip in kg^-1/2, sway in kg^1/2. The rigid rotation is orthogonal to all of them.
    """

    omega: Array
    tip: Array
    sway: Array


def bending_modes(rod: Rod, count: int) -> BendingModes:
    """The lowest `count` bending modes of the rod in one plane; 0 to 12."""
    require("rod", "bending modes in a plane", count, 0, MOST_BENDING_MODES)
    beta_L = wave_numbers(count)
    speed = sqrt(rod.bending_stiffness / (rod.mass / rod.length)) / rod.length**2
    tip = np.full(count, 2.0 / sqrt(rod.mass))
    half = np.tan(beta_L / 2) + np.tanh(beta_L / 2)
    return BendingModes(beta_L**2 * speed, tip, sqrt(rod.mass) * half / beta_L)


def wave_numbers(count: int) -> Array:
    """beta L of the lowest pinned-free bending modes, shape (count,): 3.9266, 7.0686, 10.2102, ..."""

    from scipy.optimize import brentq

    def mismatch(x: float) -> float:
        return float(np.tan(x) - np.tanh(x))

    return np.array(
        [brentq(mismatch, n * pi, (n + 0.5) * pi - 1e-9, xtol=1e-14) for n in range(1, count + 1)]
    )
