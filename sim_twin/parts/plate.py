"""Thin rectangular plates in bending by finite elements.

Kirchhoff's theory, Bogner-Fox-Schmit rectangles (conforming, bicubic); degrees of freedom w, w_x, w_y, w_xy
at each node. Source: Bogner, Fox and Schmit, Proc. Conf. Matrix Methods in Structural Mechanics (1965), 397.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_twin.ranges import require

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_FOOT_POINTS = 4
"""Gauss points a side over a foot: exact for the bicubic deflection where no mesh line crosses it."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """What a plate is made of: `E` in Pa, `rho` in kg/m3, Poisson's ratio `nu`, `thickness` in m."""

    E: float
    rho: float
    nu: float
    thickness: float

    def __post_init__(self) -> None:
        require("sheet", "E", self.E, 0.0, unit="Pa", above=True)
        require("sheet", "rho", self.rho, 0.0, unit="kg/m3", above=True)
        require("sheet", "nu", self.nu, 0.0, 0.5)
        require("sheet", "thickness", self.thickness, 0.0, unit="m", above=True)

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
    """A free plate of `sheet` on a mesh with lines at `x` and `y` (m, ascending)."""

    sheet: Sheet
    x: tuple[float, ...]
    y: tuple[float, ...]

    @cached_property
    def _basis(self) -> Any:
        from skfem import Basis, ElementQuadBFS, MeshQuad

        return Basis(MeshQuad.init_tensor(np.array(self.x), np.array(self.y)), ElementQuadBFS(), intorder=6)

    def matrices(self) -> tuple[Array, Array]:
        """Mass and stiffness of the free plate, each of shape (dofs, dofs), dofs = 4 nodes, SI."""
        from skfem import BilinearForm
        from skfem.helpers import dd, ddot, eye, trace

        D, nu = self.sheet.bending_stiffness, self.sheet.nu

        def bending(u: Any, v: Any, _: Any) -> Any:
            moment = D * ((1 - nu) * dd(u) + nu * eye(trace(dd(u)), 2))
            return ddot(moment, dd(v))

        def inertia(u: Any, v: Any, _: Any) -> Any:
            return self.sheet.mass_per_area * u * v

        M, K = (BilinearForm(form).assemble(self._basis).toarray() for form in (inertia, bending))
        return np.asarray(M), np.asarray(K)

    def rows(self, x: Array, y: Array) -> Array:
        """Rows of w, dw/dx and dw/dy at points (`x`, `y`) in m, shape (3, points, dofs)."""
        basis, points = self._basis, np.array([x, y], dtype=float)
        cells = basis.mesh.element_finder(mapping=basis.mapping)(*points)
        local = basis.mapping.invF(points[:, :, None], tind=cells)
        rows = np.zeros((3, points.shape[1], basis.N))
        for k in range(basis.Nbfun):
            field = basis.elem.gbasis(basis.mapping, local, k, tind=cells)[0]
            values = np.array([np.asarray(field)[:, 0], *field.grad[:, :, 0]])
            rows[:, np.arange(points.shape[1]), basis.element_dofs[k, cells]] = values
        return rows

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
        return np.asarray(self._basis.nodal_dofs[:, where])

    @property
    def nodes(self) -> Array:
        """Coordinates of the nodes in m, shape (2, nodes)."""
        return np.asarray(self._basis.mesh.p)


def mesh_lines(length: float, elements: int, *through: float) -> tuple[float, ...]:
    """Lines of a mesh over 0..`length`, about `elements` of equal size, with a line `through` each place."""
    stops = np.unique([0.0, *through, length])
    spans = np.diff(stops)
    counts = np.maximum(1, np.round(spans / length * elements)).astype(int)
    inner = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(stops, stops[1:], counts, strict=False)]
    return tuple(np.concatenate([*inner, [length]]).tolist())
