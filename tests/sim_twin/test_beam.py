"""The beam's finite elements and modes against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from sim_twin.parts.beam import Beam
from sim_twin.parts.modal import lowest_modes
from sim_twin.rigs.impact_beam.model import nominal

STEEL = Beam(207e9, 7800.0, 0.28, 0.019, 0.00635, 37)

# Roots of the frequency equations of a uniform beam (Blevins, Formulas for Natural Frequency, Table 8-1).
FREE_FREE = [brentq(lambda b: np.cos(b) - 1 / np.cosh(b), low, low + 1) for low in (4.5, 7.5, 10.5)]
CLAMPED_FREE = [brentq(lambda b: np.cos(b) + 1 / np.cosh(b), low, low + 1) for low in (1.5, 4.5, 7.5)]
PINNED_FREE = [brentq(lambda b: np.tan(b) - np.tanh(b), low, low + 0.7) for low in (3.5, 6.7, 9.9)]


def frequencies(beam: Beam, fixed: tuple[int, ...], count: int) -> np.ndarray:
    held = np.delete(np.eye(2 * (beam.elements + 1)), fixed, axis=1)
    return lowest_modes(beam.elastic().by(held), count).omega / (2 * np.pi)


def closed_form(beam: Beam, roots: list[float]) -> np.ndarray:
    return (
        np.square(roots)
        * np.sqrt(beam.bending_stiffness / beam.mass_per_length / beam.length**4)
        / (2 * np.pi)
    )


def test_free_beam_of_the_source_rings_at_428_9_hz() -> None:
    # Four digits are given.
    assert frequencies(STEEL, (), 3)[2] == pytest.approx(428.9, rel=2e-4)


@pytest.mark.parametrize(
    ("fixed", "rigid", "roots"),
    [((), 2, FREE_FREE), ((0,), 1, PINNED_FREE), ((0, 1), 0, CLAMPED_FREE)],
    ids=["free", "pinned", "clamped"],
)
def test_frequencies_are_those_of_the_closed_form(
    fixed: tuple[int, ...], rigid: int, roots: list[float]
) -> None:
    found = frequencies(STEEL, fixed, rigid + 3)[rigid:]
    # Too stiff by (beta le)^4 / 1440, which is 5.4e-6 for the third mode of 37 elements.
    assert found == pytest.approx(closed_form(STEEL, roots), rel=7e-6)


def test_frequencies_converge_with_the_fourth_power_of_the_element_length() -> None:
    exact = closed_form(STEEL, CLAMPED_FREE)[2]
    counts = np.array([8, 12, 16, 24])
    errors = [frequencies(replace(STEEL, elements=n), (0, 1), 3)[2] / exact - 1 for n in counts]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert order == pytest.approx(4.0, abs=0.1)


def test_pendulum_mode_is_the_flexure_turning_the_rigid_beam() -> None:
    rig = nominal()
    inertia = rig.beam.mass_per_length * rig.beam.length**3 / 3
    every = np.eye(2 * (rig.beam.elements + 1))
    hinged = rig.beam.elastic().with_spring(every[1], rig.rotation_stiffness).by(every[:, 1:])
    found = lowest_modes(hinged, 1).omega[0]
    # The beam's own bending softens it by k L / (3 EI) = 2e-4 at most.
    assert found == pytest.approx(np.sqrt(rig.rotation_stiffness / inertia), rel=2e-4)


def test_modes_are_mass_normalised_and_diagonalise_the_stiffness() -> None:
    clamped = STEEL.elastic().by(np.eye(2 * (STEEL.elements + 1))[:, 2:])
    M, K, modes = clamped.M, clamped.K, lowest_modes(clamped, 15)
    assert modes.shapes.T @ M @ modes.shapes == pytest.approx(np.eye(15), abs=1e-10)
    stiffness = modes.shapes.T @ K @ modes.shapes / modes.omega[-1] ** 2
    assert stiffness == pytest.approx(np.diag((modes.omega / modes.omega[-1]) ** 2), abs=1e-10)


def test_total_mass_and_rigid_motions_of_the_free_beam() -> None:
    M, K = STEEL.elastic().M, STEEL.elastic().K
    lifted = np.tile([1.0, 0.0], 38)
    turned = np.column_stack([np.linspace(0, 0.28, 38), np.ones(38)]).ravel()
    assert lifted @ M @ lifted == pytest.approx(7800 * 0.28 * 0.019 * 0.00635, rel=1e-12)
    assert turned @ M @ turned == pytest.approx(7800 * 0.019 * 0.00635 * 0.28**3 / 3, rel=1e-12)
    assert np.abs(K @ np.column_stack([lifted, turned])).max() < 1e-9 * np.abs(K).max()


@pytest.mark.parametrize("fraction", [0.0, 0.2, 0.69, 1.0])
def test_a_deflection_row_is_exact_for_cubics(fraction: float) -> None:
    x = np.linspace(0, 0.28, 38)
    dofs = np.column_stack([x**3, 3 * x**2]).ravel()
    assert STEEL.deflection_row(fraction) @ dofs == pytest.approx((0.28 * fraction) ** 3, abs=1e-16)
