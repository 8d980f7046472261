"""Frames of straight members in space by finite elements.

Members stretch, twist and bend (Euler-Bernoulli, consistent mass); degrees of freedom u, v, w and the
rotations about x, y, z at each node. Source: Przemieniecki, Theory of Matrix Structural Analysis (1968),
sections 5.6 and 11.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.parts.beam import bending_matrices
from sim_twin.ranges import require

Array = NDArray[np.float64]
DOFS = 6
"""Degrees of freedom at a node."""
_SHEAR_OVER_YOUNG = 1 / (2 * 1.33)


@dataclass(frozen=True, slots=True)
class Bar:
    """A rectangular bar: `E` in Pa, `rho` in kg/m3, `width` across and `depth` along its second axis in m."""

    E: float
    rho: float
    width: float
    depth: float

    def __post_init__(self) -> None:
        for name, unit in (("E", "Pa"), ("rho", "kg/m3"), ("width", "m"), ("depth", "m")):
            require("bar", name, getattr(self, name), 0.0, unit=unit, above=True)

    @property
    def area(self) -> float:
        """Cross-section, m2."""
        return self.width * self.depth

    @property
    def mass_per_length(self) -> float:
        """kg/m."""
        return self.rho * self.area

    @property
    def torsion_constant(self) -> float:
        """m4, within 1 % (Young, Roark's Formulas for Stress and Strain, 7th ed., Table 10.1, case 4)."""
        b, a = sorted((self.width, self.depth))
        return a * b**3 * (1 / 3 - 0.21 * b / a * (1 - (b / a) ** 4 / 12))


@dataclass(frozen=True, slots=True)
class Member:
    """A straight member of `bar` from node `start` to node `end`; its bar's width lies along `across`."""

    bar: Bar
    start: int
    end: int
    across: tuple[float, float, float]


def frame_matrices(nodes: Array, members: tuple[Member, ...]) -> tuple[Array, Array]:
    """Mass and stiffness of the free frame with `nodes` (n, 3) in m; each of shape (6 n, 6 n), SI."""
    M, K = np.zeros((2, DOFS * len(nodes), DOFS * len(nodes)))
    for member in members:
        turn = _turn(nodes[member.end] - nodes[member.start], np.array(member.across))
        length = float(np.linalg.norm(nodes[member.end] - nodes[member.start]))
        where = np.concatenate([DOFS * node + np.arange(DOFS) for node in (member.start, member.end)])
        for total, own in zip((M, K), _element(member.bar, length), strict=True):
            total[np.ix_(where, where)] += turn.T @ own @ turn
    return M, K


def _turn(along: Array, across: Array) -> Array:
    """Rotation of the twelve degrees of freedom into the member's axes: along, across (width), the third."""
    first = along / np.linalg.norm(along)
    axes = np.array([first, across, np.cross(first, across)])
    return np.kron(np.eye(4), axes)


def _element(bar: Bar, length: float) -> tuple[Array, Array]:
    M, K = np.zeros((2, 2 * DOFS, 2 * DOFS))
    polar = bar.area * (bar.width**2 + bar.depth**2) / 12
    for dof, mass, stiffness in (
        (0, bar.mass_per_length, bar.E * bar.area),
        (3, bar.rho * polar, bar.E * _SHEAR_OVER_YOUNG * bar.torsion_constant),
    ):
        pair = np.ix_([dof, dof + DOFS], [dof, dof + DOFS])
        M[pair] += mass * length / 6 * np.array([[2, 1], [1, 2]])
        K[pair] += stiffness / length * np.array([[1, -1], [-1, 1]])
    # Bending across the width turns about the third axis; along the third axis it turns about minus the
    # second.
    for deflection, rotation, sign, height, base in (
        (1, 5, 1.0, bar.width, bar.depth),
        (2, 4, -1.0, bar.depth, bar.width),
    ):
        signs = np.array([1.0, sign, 1.0, sign])
        where = np.ix_(*2 * [[deflection, rotation, deflection + DOFS, rotation + DOFS]])
        me, ke = bending_matrices(bar.E * base * height**3 / 12, bar.mass_per_length, length)
        M[where] += me * np.outer(signs, signs)
        K[where] += ke * np.outer(signs, signs)
    return M, K
