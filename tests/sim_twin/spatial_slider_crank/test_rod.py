"""Bending modes of a pinned-free rod against closed forms."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from scipy.integrate import quad

from daq.errors import UnphysicalParameter
from sim_twin.parts.beam import Rod, bending_modes, wave_numbers


def shape(rod: Rod, beta_L: float, s: float) -> float:
    x = beta_L * s / rod.length
    return float((np.sin(x) / np.sin(beta_L) + np.sinh(x) / np.sinh(beta_L)) / np.sqrt(rod.mass))


def over_mass(rod: Rod, f) -> float:
    return quad(f, 0.0, rod.length)[0] * rod.mass / rod.length


def test_wave_numbers_of_the_tables() -> None:
    # Blevins table 8-1.
    assert wave_numbers(3) == pytest.approx([3.92660231, 7.06858275, 10.21017612], abs=1e-8)


def test_high_wave_numbers_are_those_of_the_limit() -> None:
    assert wave_numbers(12)[-1] == pytest.approx(12.25 * pi, abs=1e-12)


def test_frequencies_of_the_steel_rod() -> None:
    # Source: 8 modes below 5 kHz, two of them rigid; the reference gives 560, 1815, 3788 Hz.
    assert bending_modes(Rod(), 4).omega / (2 * pi) == pytest.approx(
        [560.3, 1815.6, 3788.1, 6477.8], rel=2e-4
    )


def test_frequency_from_its_formula() -> None:
    rod = Rod(E=70e9, rho=2700.0, diameter=8e-3, length=0.3)
    EI, mass_per_length = 70e9 * pi * 8e-3**4 / 64, 2700.0 * pi * 8e-3**2 / 4
    expected = 3.92660231**2 / 0.3**2 * np.sqrt(EI / mass_per_length)
    assert bending_modes(rod, 1).omega[0] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("k", range(3))
def test_modes_are_normal_to_each_other_and_to_the_rotation(k: int) -> None:
    rod, beta_L = Rod(), wave_numbers(3)
    products = [
        over_mass(rod, lambda s, j=j: shape(rod, beta_L[j], s) * shape(rod, beta_L[k], s)) for j in range(3)
    ]
    assert products == pytest.approx(np.eye(3)[k], abs=1e-10)
    assert over_mass(rod, lambda s: s * shape(rod, beta_L[k], s)) == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("k", range(3))
def test_tip_and_sway_are_those_of_the_shape(k: int) -> None:
    rod, modes, beta_L = Rod(), bending_modes(Rod(), 3), wave_numbers(3)[k]
    assert modes.tip[k] == pytest.approx(shape(rod, beta_L, rod.length), rel=1e-12)
    assert modes.sway[k] == pytest.approx(over_mass(rod, lambda s: shape(rod, beta_L, s)), rel=1e-9)


@pytest.mark.parametrize("count", [-1, 13])
def test_as_many_modes_as_there_are(count: int) -> None:
    with pytest.raises(UnphysicalParameter, match="bending modes"):
        bending_modes(Rod(), count)


@pytest.mark.parametrize("field", ["E", "rho", "diameter", "length"])
def test_a_rod_has_positive_parameters(field: str) -> None:
    with pytest.raises(UnphysicalParameter, match=field):
        Rod(**{field: 0.0})
