"""Frames of straight members in space by finite elements.

Members stretch, twist and bend (Euler-Bernoulli, consistent mass); degrees of freedom u, v, w and the
rotations about x, y, z at each node. Source: Przemieniecki, Theory of Matrix Structural Analysis (1968),
sections 5.6 and 11.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from daq.quantity import Quantity
from sim_twin.parts.beam import bending
from sim_twin.parts.modal import Elastic
from sim_twin.parts.stuff import DENSITY, MODULUS
from sim_twin.ranges import require

Array = NDArray[np.float64]
DOFS = 6
"""Degrees of freedom at a node."""
_SHEAR_OVER_YOUNG = 1 / (2 * 1.33)


@dataclass(frozen=True, slots=True)
class Bar:
    """A rectangular bar: `E` in Pa, `rho` in kg/m3, `width` across and `depth` along its second axis in m."""

    E: Annotated[float, MODULUS]
    rho: Annotated[float, DENSITY]
    width: Annotated[float, Quantity("mm", 1, 500)]
    depth: Annotated[float, Quantity("mm", 1, 500)]

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


def frame(nodes: Array, members: tuple[Member, ...]) -> Elastic:
    """The free frame with `nodes` (n, 3) in m, by 6 n degrees of freedom."""
    size = DOFS * len(nodes)
    M, B = np.zeros((size, size)), np.zeros((len(members), DOFS, size))
    for member, strains in zip(members, B, strict=True):
        way = nodes[member.end] - nodes[member.start]
        length = np.linalg.norm(way)
        along, across = way / length, np.array(member.across)
        # the twelve degrees of freedom in the member's axes: along, across (width), the third
        turn = np.kron(np.eye(4), np.array([along, across, np.cross(along, across)]))
        own = _element(member.bar, float(length)).by(turn)
        where = np.concatenate([DOFS * node + np.arange(DOFS) for node in (member.start, member.end)])
        M[np.ix_(where, where)] += own.M
        strains[:, where] = own.B
    return Elastic(M, B.reshape(-1, size))


def _element(bar: Bar, length: float) -> Elastic:
    M, B = np.zeros((2 * DOFS, 2 * DOFS)), np.zeros((DOFS, 2 * DOFS))
    polar = bar.area * (bar.width**2 + bar.depth**2) / 12
    for strain, (dof, mass, stiffness) in enumerate((
        (0, bar.mass_per_length, bar.E * bar.area),
        (3, bar.rho * polar, bar.E * _SHEAR_OVER_YOUNG * bar.torsion_constant),
    )):  # fmt: skip
        ends = [dof, dof + DOFS]
        M[np.ix_(ends, ends)] += mass * length / 6 * np.array([[2, 1], [1, 2]])
        B[strain, ends] = np.sqrt(stiffness / length) * np.array([-1.0, 1.0])
    # Bending across the width turns about the third axis; along the third axis it turns about minus the
    # second.
    for strain, deflection, rotation, sign, height, base in (
        (2, 1, 5, 1.0, bar.width, bar.depth),
        (4, 2, 4, -1.0, bar.depth, bar.width),
    ):
        where = [deflection, rotation, deflection + DOFS, rotation + DOFS]
        own = bending(bar.E * base * height**3 / 12, bar.mass_per_length, length)
        own = own.by(np.diag([1.0, sign, 1.0, sign]))
        M[np.ix_(where, where)] += own.M
        B[strain : strain + 2, where] = own.B
    return Elastic(M, B)
