"""Elastic structures by their strains, and their modes to nearly full precision.

A beam that turns about a soft flexure has stiffnesses twelve orders of magnitude apart, and its pendulum mode
would drown in the rounding of the stiffness matrix. So the stiffness is kept as what it is made of, weighted
strains, in which a rigid motion costs nothing; and natural frequencies come out of those by one-sided Jacobi
rotations, which find the small singular values as accurately as the large ones (Demmel and Veselic 1992,
10.1137/0613074; LAPACK dgejsv: Drmac and Veselic 2008, 10.1137/050639193).

scipy is loaded where something is solved: a rig's parameters, which every process has, are built on this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
_BESIDE = 8
"""Modes above those asked for that are made sharp with them: an eigensolver mixes those in most."""
_REFINEMENTS = 4
"""Each takes the error down by (condition of K) x 1e-16, 1e-4 at worst."""
_ANY_COLUMNS = 0  # JOBA = C of dgejsv: columns may be of very different length
_NO_U = 3  # JOBU = N
_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")


@dataclass(frozen=True, slots=True)
class Elastic:
    """M x'' + B^T B x = f, SI. Each row of `B`, (strains, dofs), is a strain times the root of its stiffness.

    |B x|^2 is twice the strain energy in J; `M` of shape (dofs, dofs).
    """

    M: Matrix
    B: Matrix

    @property
    def K(self) -> Matrix:  # noqa: N802
        """Stiffness matrix, (dofs, dofs)."""
        return self.B.T @ self.B

    def __add__(self, other: Elastic) -> Elastic:
        """Both on the same degrees of freedom."""
        return Elastic(self.M + other.M, np.vstack([self.B, other.B]))

    def by(self, motion: Matrix) -> Elastic:
        """The structure in coordinates z that move it by x = `motion` z; (dofs, z)."""
        return Elastic(motion.T @ self.M @ motion, self.B @ motion)

    def with_mass(self, row: Matrix, mass: float) -> Elastic:
        """Add a point `mass` in kg where `row` . x moves."""
        return Elastic(self.M + mass * np.outer(row, row), self.B)

    def with_spring(self, row: Matrix, stiffness: float) -> Elastic:
        """Add a spring in N/m (N m/rad for a turning) that `row` . x stretches."""
        return Elastic(self.M, np.vstack([self.B, np.sqrt(stiffness) * row]))

    def deflection(self, load: Matrix) -> Matrix:
        """Solve K x = `load`, (dofs, loads) in N: a Cholesky solution, refined by the strains it leaves."""
        from scipy.linalg import cho_factor, cho_solve

        factor = cho_factor(self.K)
        x = cho_solve(factor, load)
        for _ in range(_REFINEMENTS):
            x += cho_solve(factor, load - self.B.T @ (self.B @ x))
        return np.asarray(x)


@dataclass(frozen=True, slots=True)
class Modes:
    """Mass-normalised modes: `omega` (n,) in rad/s ascending, `shapes` (dofs, n) in kg^-1/2.

    A mode's sign is that of its first degree of freedom that moves at least half as far as any.
    """

    omega: NDArray[np.float64]
    shapes: Matrix


def lowest_modes(structure: Elastic, count: int) -> Modes:
    """Return the lowest `count` modes (rigid-body modes come out near omega = 0)."""
    from scipy.linalg import eigh

    beside = min(count + _BESIDE, len(structure.M))
    _, shapes = eigh(structure.K, structure.M, subset_by_index=(0, beside - 1))
    sharp = sharpened(structure, shapes)
    return Modes(sharp.omega[:count], sharp.shapes[:, :count])


def sharpened(structure: Elastic, shapes: Matrix) -> Modes:
    """The modes within the span of mass-normalised `shapes`, (dofs, n), that are nearly modes already."""
    from scipy.linalg import lapack

    strains = structure.B @ shapes
    if len(strains) < shapes.shape[1]:
        strains = np.pad(strains, ((0, shapes.shape[1] - len(strains)), (0, 0)))
    values, _, turn, work, _, info = lapack.dgejsv(
        strains, joba=_ANY_COLUMNS, jobu=_NO_U, jobv=0, jobr=0, jobt=0, jobp=0
    )
    if info != 0:
        raise np.linalg.LinAlgError(f"dgejsv: info {info}")
    omega, turned = (values * work[0] / work[1])[::-1], shapes @ turn[:, ::-1]
    size = np.abs(turned)
    first = np.argmax(size >= 0.5 * size.max(axis=0), axis=0)
    return Modes(omega, turned * np.sign(turned[first, np.arange(len(first))]))


def by_one_thread(function: Callable[_Given, _Found]) -> Callable[_Given, _Found]:
    """Let modes that are computed once and kept be the same bits in every process; goes below a cache.

    More threads of BLAS would add up in another order.
    """

    @wraps(function)
    def limited(*args: _Given.args, **kwargs: _Given.kwargs) -> _Found:
        with _blas().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@cache
def _blas() -> Any:
    import scipy.linalg  # noqa: F401 - a controller finds only the libraries that are loaded
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
