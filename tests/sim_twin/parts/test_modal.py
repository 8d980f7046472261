"""Modes of structures whose stiffnesses lie far apart, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sim_twin.parts.beam import Beam
from sim_twin.parts.modal import Elastic, lowest_modes

ROUNDING = 1e-14
"""Some hundred times the spacing of doubles."""


def two_masses(soft: float, stiff: float) -> Elastic:
    """Two of 1 kg on each other by a stiff spring, the first on the ground by a soft one."""
    free = Elastic(np.eye(2), np.zeros((0, 2)))
    return free.with_spring(np.array([1.0, 0.0]), soft).with_spring(np.array([-1.0, 1.0]), stiff)


def closed_form(soft: float, stiff: float) -> np.ndarray:
    """Both omega^2 of the two masses: their sum is soft + 2 stiff, their product soft times stiff."""
    high = (soft + 2 * stiff + np.sqrt(soft**2 + 4 * stiff**2)) / 2
    return np.sqrt([soft * stiff / high, high])


@pytest.mark.parametrize("stiff", [1.0, 1e6, 1e12, 1e18])
def test_a_soft_mode_beside_a_stiff_one_keeps_its_digits(stiff: float) -> None:
    found = lowest_modes(two_masses(1.0, stiff), 2)
    assert found.omega == pytest.approx(closed_form(1.0, stiff), rel=ROUNDING)


def test_a_deflection_keeps_its_digits_where_the_stiffness_matrix_has_lost_half_of_them() -> None:
    # Refined down from a condition of 4e8; beyond some 1e15 there is no Cholesky factor to start from.
    pushed = two_masses(1.0, 1e8).deflection(np.array([[0.0], [1.0]]))
    assert pushed == pytest.approx(np.array([[1.0], [1.0 + 1e-8]]), rel=ROUNDING)


def test_a_rigid_motion_strains_a_beam_by_rounding_only() -> None:
    beam = Beam(207e9, 7800.0, 0.28, 0.019, 0.00635, 37)
    x = np.linspace(0, beam.length, beam.elements + 1)
    turned = np.column_stack([x, np.ones_like(x)]).ravel()
    free = beam.elastic()
    # Of the energy that the soft flexure of 0.16 N m/rad takes up in the same turn.
    assert np.sum((free.B @ turned) ** 2) < 1e-16 * 0.16


def test_the_sign_of_a_mode_is_that_of_its_first_large_motion() -> None:
    beam = Beam(207e9, 7800.0, 0.28, 0.019, 0.00635, 8)
    shapes = lowest_modes(beam.elastic().by(np.eye(18)[:, 2:]), 6).shapes
    for shape in shapes.T:
        assert shape[np.argmax(np.abs(shape) >= 0.5 * np.abs(shape).max())] > 0
