"""How the tip answers slow forces, against closed forms of beams that hardly bend or are clamped."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt

import pytest

from sim_twin.rigs.impact_beam.model import FLEXURE_ROTATION, nominal
from sim_twin.rigs.impact_beam.structure import resting, tip_response

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
