"""Component-mode synthesis against the structures that it reduces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh, solve

from daq.errors import UnphysicalParameter
from sim_twin.parts.beam import Beam
from sim_twin.parts.synthesis import Leading, craig_bampton, modal_damping

BEAM = Beam(207e9, 7800.0, 0.28, 0.019, 0.00635, 20)
COUNTS = (0, 2, 4, 8, 16)


def clamped() -> tuple[np.ndarray, np.ndarray]:
    M, K = BEAM.matrices()
    return M[2:, 2:], K[2:, 2:]


def tip_and_mean() -> np.ndarray:
    """Boundary: deflection of the tip, and mean deflection at three places."""
    mean = np.mean([BEAM.deflection_row(at) for at in (0.4, 0.5, 0.6)], axis=0)
    return np.array([BEAM.deflection_row(1.0), mean])[:, 2:]


def frequencies(modes: int) -> np.ndarray:
    reduced = craig_bampton(*clamped(), tip_and_mean(), modes)
    return np.sqrt(eigh(reduced.K, reduced.M, eigvals_only=True))


def test_frequencies_come_down_to_those_of_the_whole() -> None:
    M, K = clamped()
    exact = np.sqrt(eigh(K, M, eigvals_only=True)[:2])
    errors = np.array([frequencies(modes)[:2] / exact - 1 for modes in COUNTS])
    rounding = 1e-7  # of the lowest eigenvalue beside one 1e8 times larger
    assert errors.min() > -rounding
    assert np.diff(errors, axis=0).max() < rounding
    # The error falls with the fourth power of the first frequency left out (Craig and Bampton 1968).
    assert errors[2].max() < 1e-3
    assert errors[-1].max() < 1e-6


def test_all_modes_give_the_whole() -> None:
    M, K = clamped()
    exact = np.sqrt(eigh(K, M, eigvals_only=True))
    assert frequencies(len(M) - 2) == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("modes", [0, 3])
def test_static_deflections_at_the_boundary_are_exact(modes: int) -> None:
    M, K = clamped()
    rows = tip_and_mean()
    reduced = craig_bampton(M, K, rows, modes)
    load = np.array([1.0, -3.0])
    whole = solve(K, rows.T @ load)
    part = reduced.basis @ solve(reduced.K, np.concatenate([load, np.zeros(modes)]))
    assert part == pytest.approx(whole, rel=1e-7, abs=1e-9 * np.abs(whole).max())


def test_the_boundary_coordinates_are_the_boundary_motions() -> None:
    reduced = craig_bampton(*clamped(), tip_and_mean(), 5)
    assert tip_and_mean() @ reduced.basis == pytest.approx(np.eye(2, 7), abs=1e-9)
    M = reduced.basis.T @ clamped()[0] @ reduced.basis
    assert pytest.approx(M, abs=1e-9) == reduced.M
    assert reduced.M[2:, 2:] == pytest.approx(np.eye(5), abs=1e-9)


def test_modes_out_of_the_boundarys_reach_are_passed_over() -> None:
    M, K = BEAM.matrices()
    kept = np.setdiff1d(np.arange(len(M)), [0, 1, len(M) - 2, len(M) - 1])  # clamped at both ends
    M, K = M[np.ix_(kept, kept)], K[np.ix_(kept, kept)]
    middle = BEAM.deflection_row(0.5)[None, kept]
    held = craig_bampton(M, K, middle, 3)
    # With its middle held the beam has modes in pairs; of each pair one is antisymmetric, and a motion of the
    # middle excites the symmetric one only: that of a half of the beam, clamped at both ends (Blevins 8-1).
    roots = np.array([4.730041, 7.853205, 10.995608])
    half = BEAM.length / 2
    expected = roots**2 * np.sqrt(BEAM.bending_stiffness / BEAM.mass_per_length) / half**2
    # Ten elements in a half are too stiff by (beta le)^4 / 1440 = 1e-3 at most.
    assert held.omega == pytest.approx(expected, rel=1.1e-3)


def test_leading_modes_are_those_that_matter_to_their_row() -> None:
    M, K = clamped()
    mass, spring = 1e-5, 1.0
    M, K = np.pad(M, (0, 1)), np.pad(K, (0, 1))
    M[-1, -1] = mass
    hook = np.append(-BEAM.deflection_row(0.5)[2:], 1.0)
    K += spring * np.outer(hook, hook)
    tip = np.append(BEAM.deflection_row(1.0)[2:], 0.0)[None]
    # A speck on a soft spring in the middle: the lowest mode of all, and next to nothing to the tip.
    assert craig_bampton(M, K, tip, 1).omega == pytest.approx([np.sqrt(spring / mass)], rel=1e-3)
    bare = craig_bampton(*clamped(), tip[:, :-1], 2)
    assert craig_bampton(M, K, tip, 0, leading=Leading(0, 2)).omega == pytest.approx(bare.omega, rel=1e-3)


def test_every_mode_gets_its_damping_ratio() -> None:
    M, K = clamped()
    C = modal_damping(M, K, 0.02)
    squared, shapes = eigh(K, M)
    ratios = np.diag(shapes.T @ C @ shapes) / (2 * np.sqrt(squared))
    assert ratios == pytest.approx(0.02, rel=1e-6)


def test_more_modes_than_the_mesh_has_are_refused() -> None:
    with pytest.raises(UnphysicalParameter, match=r"tail: modes = 40: at least 0, at most 38"):
        craig_bampton(*clamped(), tip_and_mean(), 40, "tail")


@pytest.mark.parametrize("fraction", [0.0, 0.2, 0.69, 1.0])
def test_a_slope_row_is_exact_for_cubics(fraction: float) -> None:
    x = np.linspace(0, 0.28, 21)
    dofs = np.column_stack([x**3, 3 * x**2]).ravel()
    assert BEAM.slope_row(fraction) @ dofs == pytest.approx(3 * (0.28 * fraction) ** 2, abs=1e-14)
