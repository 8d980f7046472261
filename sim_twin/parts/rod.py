"""A slender round rod, pinned at one end and free at the other, in bending.

Exact Euler-Bernoulli modes: tan(beta L) = tanh(beta L). The free end carries whatever force acts there, so
the modes are those of a force boundary. Source: Blevins, Formulas for Natural Frequency and Mode Shape
(1979), table 8-1, case pinned-free.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from sim_twin.ranges import require

Array = NDArray[np.float64]
MOST_BENDING_MODES = 12
"""In each plane; the next would bend within one diameter of a rod 30 diameters long."""


@dataclass(frozen=True, slots=True)
class Rod:
    """`E` in Pa, `rho` in kg/m3, `diameter` and `length` in m."""

    E: float = 207e9
    rho: float = 7800.0
    diameter: float = 6.4e-3
    length: float = 0.19

    def __post_init__(self) -> None:
        for name, unit in (("E", "Pa"), ("rho", "kg/m3"), ("diameter", "m"), ("length", "m")):
            require("rod", name, getattr(self, name), 0.0, unit=unit, above=True)

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
