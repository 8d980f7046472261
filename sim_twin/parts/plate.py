"""Thin rectangular plates in bending by finite elements.

Kirchhoff's theory, Bogner-Fox-Schmit rectangles (conforming, bicubic); degrees of freedom w, w_x, w_y, w_xy
at each node. Source: Bogner, Fox and Schmit, Proc. Conf. Matrix Methods in Structural Mechanics (1965), 397.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from daq.quantity import Bound, Quantity
from sim_twin.parts.beam import hermite_rows
from sim_twin.parts.modal import Elastic
from sim_twin.parts.stuff import DENSITY, MODULUS, POISSON
from sim_twin.ranges import require_bounds

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_FOOT_POINTS = 4
"""Gauss points a side over a foot: exact for the bicubic deflection where no mesh line crosses it."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """What a plate is made of: `E` in Pa, `rho` in kg/m3, Poisson's ratio `nu`, `thickness` in m."""

    E: Annotated[float, MODULUS, Bound("Pa", 0.0, above=True)]
    rho: Annotated[float, DENSITY, Bound("kg/m3", 0.0, above=True)]
    nu: Annotated[float, POISSON, Bound("", 0.0, 0.5)]
    thickness: Annotated[float, Quantity("mm", 0.1, 200), Bound("m", 0.0, above=True)]

    def __post_init__(self) -> None:
        require_bounds("sheet", self)

    @property
    def bending_stiffness(self) -> float:
        """D = E h^3 / (12 (1 - nu^2)), N m."""
        return self.E * self.thickness**3 / (12 * (1 - self.nu**2))

    @property
    def mass_per_area(self) -> float:
        """rho h, kg/m2."""
        return self.rho * self.thickness


@dataclass(frozen=True)
class Plate:
    """A free plate of `sheet` on a mesh with lines at `x` and `y` (m, ascending).

    A rectangle's shapes are products of a beam's along x and along y, and so are the rows at its points.
    """

    sheet: Sheet
    x: tuple[float, ...]
    y: tuple[float, ...]

    def elastic(self) -> Elastic:
        """The free plate, by 4 degrees of freedom a node."""
        values = (_weighted_rows(np.array(line))[0] for line in (self.x, self.y))
        M = np.asarray(self.sheet.mass_per_area * np.kron(*(each.T @ each for each in values)), np.float64)
        B = np.zeros((len(self.x) - 1, len(self.y) - 1, 16, len(M)))
        for i, width in enumerate(np.diff(self.x)):
            for j, depth in enumerate(np.diff(self.y)):
                own = np.add.outer((2 * i + np.arange(4)) * 2 * len(self.y), 2 * j + np.arange(4))
                B[i, j][:, own.ravel()] = _cell(self.sheet, float(width), float(depth))
        return Elastic(M, B.reshape(-1, len(M)))

    def rows(self, x: Array, y: Array) -> Array:
        """Rows of w, dw/dx and dw/dy at points (`x`, `y`) in m, shape (3, points, dofs)."""

        def row(along_x: int, along_y: int) -> Array:
            of_x = hermite_rows(np.array(self.x), np.asarray(x, dtype=float), along_x)
            of_y = hermite_rows(np.array(self.y), np.asarray(y, dtype=float), along_y)
            return (of_x[:, :, None] * of_y[:, None, :]).reshape(len(of_x), -1)

        return np.array([row(0, 0), row(1, 0), row(0, 1)])

    def foot_rows(self, x: float, y: float, width: float, depth: float) -> Array:
        """Rows of the mean w, dw/dx, dw/dy under a foot of `width` (x) and `depth` (y) around a point.

        Shape (3, dofs). A couple on a point would turn a Kirchhoff plate without end, so the mean slopes are
        taken from the deflections along the foot's edges, which is the same by Gauss's theorem.
        """
        nodes, weights = np.polynomial.legendre.leggauss(_FOOT_POINTS)
        along_x, along_y, ones = x + nodes * width / 2, y + nodes * depth / 2, np.ones(_FOOT_POINTS)
        X, Y = np.meshgrid(along_x, along_y)
        share = weights / 2

        def edge(X: Array, Y: Array) -> Array:
            return np.asarray(share @ self.rows(X, Y)[0])

        mean = np.outer(share, share).ravel() @ self.rows(X.ravel(), Y.ravel())[0]
        right, left = (edge((x + side * width / 2) * ones, along_y) for side in (1, -1))
        far, near = (edge(along_x, (y + side * depth / 2) * ones) for side in (1, -1))
        return np.array([mean, (right - left) / width, (far - near) / depth])

    def dofs(self, where: NDArray[np.bool_]) -> Index:
        """Degrees of freedom of the nodes `where`, shape (4, nodes): w, w_x, w_y, w_xy."""
        i, j = np.divmod(np.flatnonzero(where), len(self.y))
        first, row = 4 * i * len(self.y) + 2 * j, 2 * len(self.y)
        return np.array([first, first + row, first + 1, first + row + 1])

    @property
    def nodes(self) -> Array:
        """Coordinates of the nodes in m, shape (2, nodes)."""
        return np.array(np.meshgrid(self.x, self.y, indexing="ij")).reshape(2, -1)


@lru_cache(maxsize=256)
def _cell(sheet: Sheet, width: float, depth: float) -> Array:
    """Weighted strains of a rectangle of `width` (x) and `depth` (y) in m, (16, 16).

    Twice its energy is D ((1 - nu) (w_xx^2 + w_yy^2 + 2 w_xy^2) + nu (w_xx + w_yy)^2), integrated.
    """
    D, nu = sheet.bending_stiffness, sheet.nu
    x, y = (_weighted_rows(np.array([0.0, length])) for length in (width, depth))
    xx, yy, xy = np.kron(x[2], y[0]), np.kron(x[0], y[2]), np.kron(x[1], y[1])
    alone = [np.sqrt(1 - nu) * each for each in (xx, yy, np.sqrt(2) * xy)]
    return np.asarray(np.sqrt(D) * np.linalg.qr(np.vstack([*alone, np.sqrt(nu) * (xx + yy)]), mode="r"))


def _weighted_rows(nodes: Array) -> Array:
    """Rows of value, slope and curvature at points of integration, times the roots of their weights.

    Shape (3, points, 2 nodes); exact for products of cubics.
    """
    at, weights = np.polynomial.legendre.leggauss(4)
    half = np.diff(nodes)[:, None] / 2
    places = (nodes[:-1, None] + half * (1 + at)).ravel()
    roots = np.sqrt(half * weights).reshape(-1, 1)
    return np.array([roots * hermite_rows(nodes, places, derivative) for derivative in range(3)])


def mesh_lines(length: float, elements: int, *through: float) -> tuple[float, ...]:
    """Lines of a mesh over 0..`length`, about `elements` of equal size, with a line `through` each place."""
    stops = np.unique([0.0, *through, length])
    spans = np.diff(stops)
    counts = np.maximum(1, np.round(spans / length * elements)).astype(int)
    inner = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(stops, stops[1:], counts, strict=False)]
    return tuple(np.concatenate([*inner, [length]]).tolist())
