"""Frames of members against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh, solve

from daq.errors import UnphysicalParameter
from sim_twin.parts.frame import DOFS, Bar, Member, frame

BAR = Bar(70e9, 2700.0, 0.02, 0.01)
L = 0.3
I_WIDTH, I_DEPTH = 0.01 * 0.02**3 / 12, 0.02 * 0.01**3 / 12
Vector = tuple[float, float, float]
ORIENTATIONS: list[tuple[Vector, Vector]] = [
    ((1, 0, 0), (0, 1, 0)),
    ((0, 0, 1), (0, 1, 0)),
    ((0, 1, 0), (1, 0, 0)),
    ((0.6, 0, 0.8), (0, 1, 0)),
]


def cantilever(along: Vector, across: Vector, elements: int) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness with the first node held."""
    nodes = np.linspace(0, L, elements + 1)[:, None] * np.array(along)
    members = tuple(Member(BAR, i, i + 1, across) for i in range(elements))
    free = frame(nodes, members)
    return free.M[DOFS:, DOFS:], free.K[DOFS:, DOFS:]


@pytest.mark.parametrize(("along", "across"), ORIENTATIONS)
def test_tip_of_a_cantilever(along: Vector, across: Vector) -> None:
    _, K = cantilever(along, across, 2)
    axes = np.array([along, across, np.cross(along, across)])
    flexibility = np.linalg.inv(K)[-DOFS:, -DOFS:]
    found = [axis @ flexibility[:3, :3] @ axis for axis in axes]
    expected = [L / (BAR.E * BAR.area), L**3 / (3 * BAR.E * I_WIDTH), L**3 / (3 * BAR.E * I_DEPTH)]
    assert found == pytest.approx(expected, rel=1e-9)
    turning = [axis @ flexibility[3:, 3:] @ axis for axis in axes[1:]]
    assert turning == pytest.approx([L / (BAR.E * I_DEPTH), L / (BAR.E * I_WIDTH)], rel=1e-9)


def test_a_force_sideways_turns_the_tip_the_right_way() -> None:
    _, K = cantilever((0, 0, 1), (0, 1, 0), 1)
    tip = solve(K, np.array([1.0, 0, 0, 0, 0, 0]))
    # Pushed along x, a post along z turns about +y by L^2 / (2 EI).
    assert tip[4] == pytest.approx(L**2 / (2 * BAR.E * I_DEPTH), rel=1e-9)


def test_torsion_of_a_rectangular_bar() -> None:
    # Timoshenko and Goodier, Theory of Elasticity, section 109: k1 = 0.229 for two to one.
    assert BAR.torsion_constant / (0.02 * 0.01**3) == pytest.approx(0.229, rel=1e-2)


def test_first_bending_frequencies_of_a_cantilever() -> None:
    M, K = cantilever((0, 0, 1), (0, 1, 0), 6)
    found = np.sqrt(eigh(K, M, eigvals_only=True)[:2])
    expected = [
        1.875104**2 * np.sqrt(BAR.E * inertia / BAR.mass_per_length) / L**2 for inertia in (I_DEPTH, I_WIDTH)
    ]
    # Six elements are too stiff by (beta le)^4 / 1440 = 7e-6.
    assert found == pytest.approx(expected, rel=1e-5)


def test_mass_and_rigid_motions_of_a_free_frame() -> None:
    nodes = np.array([[0, 0, 0], [0.2, 0, 0], [0.2, 0.1, 0.3]], dtype=float)
    members = Member(BAR, 0, 1, (0, 1, 0)), Member(BAR, 1, 2, (1, 0, 0))
    M, K = frame(nodes, members).M, frame(nodes, members).K
    motions = np.zeros((3 * DOFS, 6))
    for i, node in enumerate(nodes):
        motions[DOFS * i : DOFS * i + 6, :3] = np.eye(6)[:, :3]
        motions[DOFS * i + 3 : DOFS * i + 6, 3:] = np.eye(3)
        motions[DOFS * i : DOFS * i + 3, 3:] = np.cross(np.eye(3), node).T
    mass = BAR.mass_per_length * (0.2 + np.hypot(0.1, 0.3))
    assert np.diag(motions.T @ M @ motions)[:3] == pytest.approx(mass, rel=1e-12)
    assert np.abs(K @ motions).max() < 1e-9 * np.abs(K).max()


def test_a_bar_that_cannot_be() -> None:
    with pytest.raises(UnphysicalParameter, match=r"bar: width = -0\.01: above 0 m"):
        Bar(70e9, 2700.0, -0.01, 0.01)
