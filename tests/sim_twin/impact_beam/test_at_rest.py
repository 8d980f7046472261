"""How the tip answers slow forces, against closed forms of beams that hardly bend or are clamped."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest

from sim_twin.parts.beam import Beam
from sim_twin.rigs.impact_beam.model import FLEXURE_ROTATION, FLEXURE_TRANSLATION, ImpactBeam, nominal
from sim_twin.rigs.impact_beam.structure import resting, structure_of, tip_response

L, DRIVE = 0.28, 0.69 * 0.28
STEEL, ALUMINIUM = nominal(), nominal("aluminium")


def test_a_pinned_beam_turns_about_its_flexure() -> None:
    """M = F x_drive, angle M / k, tip L angle; and it bends, as if it were clamped there.

    Bending adds 7 parts in 100,000, of which 15 modes leave out 2e-3.
    """
    inertia = 0.019 * 0.00635**3 / 12
    bending = DRIVE**2 * (3 * L - DRIVE) / (6 * 207e9 * inertia)
    expected = DRIVE * L / FLEXURE_ROTATION + bending
    assert resting(STEEL).compliance == pytest.approx(expected, rel=2e-3 * bending / expected)


def test_a_shakers_suspension_adds_to_the_flexure() -> None:
    """Bending between drive and tip adds a part in a thousand."""
    held = resting(replace(STEEL, shaker_stiffness=3e3))
    stiffness = FLEXURE_ROTATION + 3e3 * DRIVE**2
    assert held.compliance == pytest.approx(DRIVE * L / stiffness, rel=3e-3)
    inertia = 7800 * L * 0.019 * 0.00635 * L**2 / 3
    assert held.frequency == pytest.approx(sqrt(stiffness / inertia) / (2 * pi), rel=3e-3)
    assert held.decay_s == pytest.approx(1 / (0.01 * 2 * pi * held.frequency), rel=1e-3)


def test_a_clamped_beam_bends() -> None:
    """Tip of a cantilever under a force at a: F a^2 (3 L - a) / (6 E I). 15 modes leave 2e-3."""
    inertia = 0.019 * 0.00318**3 / 12
    assert resting(ALUMINIUM).compliance == pytest.approx(
        DRIVE**2 * (3 * L - DRIVE) / (6 * 70e9 * inertia), rel=2e-3
    )


def test_far_below_resonance_the_tip_follows_and_at_resonance_it_rings() -> None:
    beam = resting(ALUMINIUM)
    assert tip_response(ALUMINIUM, beam.frequency / 100).real == pytest.approx(beam.compliance, rel=2e-4)
    # one mode of damping ratio 0.01 answers 50-fold at its resonance; the others have 3 % of the way
    assert abs(tip_response(ALUMINIUM, beam.frequency)) == pytest.approx(50 * beam.compliance, rel=0.05)


def strip(length: float, width: float, thickness: float) -> tuple[float, float]:
    """Stiffness of a strip that is clamped at one end, of the other: it turns freely; it stays parallel."""
    K = Beam(207e9, 7800.0, length, width, thickness, 1).elastic().K[2:, 2:]
    return float(1 / np.linalg.inv(K)[1, 1]), float(K[0, 0])


def on_flexure(length: float, width: float, thickness: float, gives: bool = False) -> ImpactBeam:
    return nominal(
        flexure_translation=gives, flexure_length=length, flexure_width=width, flexure_thickness=thickness
    )


def test_a_flexure_of_other_dimensions_is_as_much_stiffer_as_a_strip_of_these() -> None:
    own, other = (4e-3, 19e-3, 0.127e-3), (8e-3, 9.5e-3, 0.381e-3)
    assert on_flexure(*own) == STEEL
    rig = on_flexure(*other, gives=True)
    turns, gives = np.divide(strip(*other), strip(*own))
    assert rig.rotation_stiffness == pytest.approx(turns * FLEXURE_ROTATION, rel=1e-9)
    assert rig.pivot_stiffness == pytest.approx(gives * FLEXURE_TRANSLATION, rel=1e-9)


def test_a_beam_on_a_flexure_of_twice_the_thickness_swings_as_a_pendulum_on_eight_times_the_spring() -> None:
    inertia = 7800 * L * 0.019 * 0.00635 * L**2 / 3
    # the beam's own bending softens it by k L / (3 EI) = 1.4e-3 at most, its frequency by half of that
    assert resting(nominal(flexure_thickness=0.254e-3)).frequency == pytest.approx(
        sqrt(8 * FLEXURE_ROTATION / inertia) / (2 * pi), rel=1e-3
    )


def test_at_its_resonance_a_mode_answers_by_its_own_damping() -> None:
    """In quadrature by 1 / (2 ratio) of its static answer; others have 4 ratios' product of that there."""
    assert nominal("aluminium", mode_damping=(0.01, 0.01)) == ALUMINIUM
    other = nominal("aluminium", mode_damping=(0.01, 0.03))
    assert other.modal_damping == (0.01, 0.03, *(0.01,) * 13)
    frequencies = np.sqrt(np.diag(structure_of(ALUMINIUM).K)[:3]) / (2 * pi)
    ratios = [tip_response(ALUMINIUM, f).imag / tip_response(other, f).imag for f in frequencies]
    assert ratios == pytest.approx([1.0, 3.0, 1.0], rel=1e-2)
