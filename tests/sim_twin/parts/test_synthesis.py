"""Component-mode synthesis against the structures that it reduces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve

from daq.errors import UnphysicalParameter
from sim_twin.parts.beam import Beam
from sim_twin.parts.modal import Elastic, lowest_modes
from sim_twin.parts.synthesis import Leading, craig_bampton, modal_damping

BEAM = Beam(207e9, 7800.0, 0.28, 0.019, 0.00635, 20)
COUNTS = (0, 2, 4, 8, 16)


def clamped() -> Elastic:
    return BEAM.elastic().by(np.eye(2 * (BEAM.elements + 1))[:, 2:])


def tip_and_mean() -> np.ndarray:
    """Boundary: deflection of the tip, and mean deflection at three places."""
    mean = np.mean([BEAM.deflection_row(at) for at in (0.4, 0.5, 0.6)], axis=0)
    return np.array([BEAM.deflection_row(1.0), mean])[:, 2:]


def frequencies(modes: int) -> np.ndarray:
    reduced = craig_bampton(clamped(), tip_and_mean(), modes).elastic
    return lowest_modes(reduced, len(reduced.M)).omega


def test_frequencies_come_down_to_those_of_the_whole() -> None:
    exact = lowest_modes(clamped(), 2).omega
    errors = np.array([frequencies(modes)[:2] / exact - 1 for modes in COUNTS])
    rounding = 1e-12
    assert errors.min() > -rounding
    assert np.diff(errors, axis=0).max() < rounding
    # The error falls with the fourth power of the first frequency left out (Craig and Bampton 1968).
    assert errors[2].max() < 1e-3
    assert errors[-1].max() < 1e-6


def test_all_modes_give_the_whole() -> None:
    exact = lowest_modes(clamped(), 2 * BEAM.elements).omega
    assert frequencies(2 * BEAM.elements - 2) == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("modes", [0, 3])
def test_static_deflections_at_the_boundary_are_exact(modes: int) -> None:
    rows = tip_and_mean()
    reduced = craig_bampton(clamped(), rows, modes)
    load = np.array([1.0, -3.0])
    whole = clamped().deflection(rows.T @ load)
    part = reduced.basis @ solve(reduced.elastic.K, np.concatenate([load, np.zeros(modes)]))
    assert part == pytest.approx(whole, rel=1e-10, abs=1e-12 * np.abs(whole).max())


def test_the_boundary_coordinates_are_the_boundary_motions() -> None:
    reduced = craig_bampton(clamped(), tip_and_mean(), 5)
    assert tip_and_mean() @ reduced.basis == pytest.approx(np.eye(2, 7), abs=1e-9)
    M = reduced.basis.T @ clamped().M @ reduced.basis
    assert pytest.approx(M, abs=1e-9) == reduced.elastic.M
    assert reduced.elastic.M[2:, 2:] == pytest.approx(np.eye(5), abs=1e-9)


def test_modes_out_of_the_boundarys_reach_are_passed_over() -> None:
    both_ends = np.eye(2 * (BEAM.elements + 1))[:, 2:-2]
    middle = BEAM.deflection_row(0.5)[None, 2:-2]
    held = craig_bampton(BEAM.elastic().by(both_ends), middle, 3)
    # With its middle held the beam has modes in pairs; of each pair one is antisymmetric, and a motion of the
    # middle excites the symmetric one only: that of a half of the beam, clamped at both ends (Blevins 8-1).
    roots = np.array([4.730041, 7.853205, 10.995608])
    half = BEAM.length / 2
    expected = roots**2 * np.sqrt(BEAM.bending_stiffness / BEAM.mass_per_length) / half**2
    # Ten elements in a half are too stiff by (beta le)^4 / 1440 = 1e-3 at most.
    assert held.omega == pytest.approx(expected, rel=1.1e-3)


def test_leading_modes_are_those_that_matter_to_their_row() -> None:
    mass, spring = 1e-5, 1.0
    beam = clamped().by(np.eye(2 * BEAM.elements, 2 * BEAM.elements + 1))
    hook = np.append(-BEAM.deflection_row(0.5)[2:], 1.0)
    hooked = beam.with_mass(np.eye(len(beam.M))[-1], mass).with_spring(hook, spring)
    tip = np.append(BEAM.deflection_row(1.0)[2:], 0.0)[None]
    # A speck on a soft spring in the middle: the lowest mode of all, and next to nothing to the tip.
    assert craig_bampton(hooked, tip, 1).omega == pytest.approx([np.sqrt(spring / mass)], rel=1e-3)
    bare = craig_bampton(clamped(), tip[:, :-1], 2)
    assert craig_bampton(hooked, tip, 0, leading=Leading(0, 2)).omega == pytest.approx(bare.omega, rel=1e-3)


def test_every_mode_gets_its_damping_ratio() -> None:
    C = modal_damping(clamped(), 0.02)
    modes = lowest_modes(clamped(), 2 * BEAM.elements)
    ratios = np.diag(modes.shapes.T @ C @ modes.shapes) / (2 * modes.omega)
    assert ratios == pytest.approx(0.02, rel=1e-6)


def test_more_modes_than_the_mesh_has_are_refused() -> None:
    with pytest.raises(UnphysicalParameter, match=r"tail: modes = 40: at least 0, at most 38"):
        craig_bampton(clamped(), tip_and_mean(), 40, "tail")


@pytest.mark.parametrize("fraction", [0.0, 0.2, 0.69, 1.0])
def test_a_slope_row_is_exact_for_cubics(fraction: float) -> None:
    x = np.linspace(0, 0.28, 21)
    dofs = np.column_stack([x**3, 3 * x**2]).ravel()
    assert BEAM.slope_row(fraction) @ dofs == pytest.approx(3 * (0.28 * fraction) ** 2, abs=1e-14)
