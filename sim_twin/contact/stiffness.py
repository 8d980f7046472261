"""Stiffness of a Hertzian pair of surfaces (seed 001 eq. 9-10)."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from sim_twin.ranges import require


@dataclass(frozen=True, slots=True)
class Elastic:
    """Elastic constants of a body: Young's modulus `E` in Pa and Poisson's ratio `nu`."""

    E: float
    nu: float

    def __post_init__(self) -> None:
        require("material", "E", self.E, 0.0, unit="Pa", above=True)
        require("material", "nu", self.nu, -1.0, 0.5, above=True)

    @property
    def h(self) -> float:
        """(1 - nu^2) / E in 1/Pa (eq. 10)."""
        return (1.0 - self.nu**2) / self.E


def generalised_stiffness(R_i: float, R_j: float, i: Elastic, j: Elastic) -> float:
    """K in N/m^1.5 of radii in m, negative for a concave surface (eq. 9).

    Raises ValueError for a pair that does not touch at a point: two concave ones, or a hollow that is smaller
    than what lies in it.
    """
    curvature = 1.0 / R_i + 1.0 / R_j
    if curvature <= 0.0:
        raise ValueError(f"surfaces of radii {R_i:g} m and {R_j:g} m do not touch at a point")
    return 4.0 / (3.0 * (i.h + j.h)) * sqrt(1.0 / curvature)
