"""Stiffness of a pair of surfaces (seed 001 eq. 9-10)."""

from __future__ import annotations

import pytest

from daq.errors import UnphysicalParameter
from sim_twin.rigs.planar_slider_crank.model import Elastic, generalised_stiffness

STEEL = Elastic(207e9, 0.3)


def test_journal_of_flores() -> None:
    # 10 mm bearing, 9.5 mm journal, steel: 6.61e10 N/m^1.5 in print, three digits.
    assert generalised_stiffness(9.5e-3, -10e-3, STEEL, STEEL) == pytest.approx(6.61e10, rel=1e-3)


def test_the_rig_of_the_source() -> None:
    assert generalised_stiffness(10e-3, -11e-3, STEEL, STEEL) == pytest.approx(5.03e10, rel=1e-3)


def test_ball_on_plane_is_hertz() -> None:
    # Hertz: F = 4/3 E* sqrt(R) d^1.5, 1/E* = 2 (1 - nu^2) / E; a plane is a ball without end.
    E_star, R = 207e9 / (2 * (1 - 0.3**2)), 5e-3
    assert generalised_stiffness(R, 1e9, STEEL, STEEL) == pytest.approx(4 / 3 * E_star * R**0.5, rel=1e-9)


@pytest.mark.parametrize("bearing", [-10e-3, -9e-3])
def test_refuses_a_hollow_that_is_too_small(bearing: float) -> None:
    with pytest.raises(ValueError, match="do not touch at a point"):
        generalised_stiffness(10e-3, bearing, STEEL, STEEL)


@pytest.mark.parametrize(("E", "nu"), [(-1.0, 0.3), (207e9, 0.6)])
def test_refuses_what_no_material_has(E: float, nu: float) -> None:
    with pytest.raises(UnphysicalParameter, match="material"):
        Elastic(E, nu)
