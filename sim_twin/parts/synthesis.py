"""Component-mode synthesis: a structure by the motions of its boundary and a few of its own modes.

Method: fixed-interface modes with static constraint modes, Craig and Bampton 1968 (10.2514/3.4741); the
boundary may be any linear combinations of degrees of freedom (a mean over a foot, a relative motion).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, qr

from sim_twin.parts.modal import Elastic, lowest_modes
from sim_twin.ranges import require

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_UNMOVED = 1e-9
"""Share of the boundary's mass below which a mode counts as out of its reach (by symmetry)."""


@dataclass(frozen=True, slots=True)
class Component:
    """A structure reduced to x = `basis` z, z = [boundary motions, interior modes]; `elastic` is that in z.

    `omega` (rad/s, ascending) are the interior modes kept; in them M is the identity and K is omega^2.
    """

    elastic: Elastic
    basis: Array
    boundary: int
    omega: Array

    @property
    def size(self) -> int:
        """Number of coordinates z."""
        return len(self.elastic.M)


@dataclass(frozen=True, slots=True)
class Leading:
    """Keep `modes` more of the interior modes: those that matter most where `row` of the boundary moves."""

    row: int
    modes: int


def craig_bampton(
    whole: Elastic, boundary: Array, modes: int, owner: str = "component", leading: Leading | None = None
) -> Component:
    """Reduce `whole` to the `boundary` rows, shape (b, dofs), and the lowest `modes` interior modes.

    Modes that the boundary cannot excite are passed over. K must hold what the boundary leaves free. Raises
    UnphysicalParameter (of `owner`) where there are fewer modes than asked for.
    """
    # motions that keep the boundary at rest, and motions that move one row of it by one
    Q, R = qr(boundary.T)[:2]
    free: Array = np.asarray(Q[:, len(boundary) :])
    unit: Array = np.asarray(Q[:, : len(boundary)] @ np.linalg.inv(R[: len(boundary)].T))
    interior = whole.by(free)
    constraint = unit - free @ interior.deflection(interior.B.T @ (whole.B @ unit))
    # rounding mixes modes of nearly one frequency: shares and order are those of the sharp ones
    sharp = lowest_modes(interior, len(interior.M))
    pushed = free.T @ whole.M @ constraint
    # effective mass of each mode for each boundary motion, over what moves with that, (modes, b)
    diagonal = np.diag(constraint.T @ whole.M @ constraint)
    shares = (sharp.shapes.T @ pushed) ** 2 / np.where(diagonal > 0, diagonal, np.inf)
    reached = np.flatnonzero(shares.sum(axis=1) > _UNMOVED)
    require(owner, "modes", modes + (leading.modes if leading else 0), 0, len(reached))
    chosen = np.arange(modes)
    if leading is not None:
        # share of mass over omega^2: what a mode adds to the stiffness of the boundary when that moves
        weights = shares[reached[modes:], leading.row] / sharp.omega[reached[modes:]] ** 2
        ranked = modes + np.argsort(-weights, kind="stable")
        chosen = np.sort(np.concatenate([chosen, ranked[: leading.modes]]))
    kept = reached[chosen]
    basis = np.hstack([constraint, free @ sharp.shapes[:, kept]])
    strains = block_diag(qr(whole.B @ constraint, mode="r")[0][: len(boundary)], np.diag(sharp.omega[kept]))
    return Component(Elastic(basis.T @ whole.M @ basis, strains), basis, len(boundary), sharp.omega[kept])


def modal_damping(structure: Elastic, ratio: float) -> Array:
    """Damping matrix that gives every mode of `structure` the damping `ratio`; rigid-body modes get none."""
    modes = lowest_modes(structure, len(structure.M))
    weighted = structure.M @ modes.shapes
    return np.asarray((weighted * (2 * ratio * modes.omega)) @ weighted.T)
