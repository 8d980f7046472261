"""A contact's peak is the largest force of the motion, wherever in a step it lies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from sim_twin.contact import ContactLaw, hertz, linear
from sim_twin.mechanisms.run import PEAK, StepLimits
from sim_twin.mechanisms.simulation import Simulation
from tests.sim_twin.mechanisms import falling_mass
from tests.sim_twin.mechanisms.falling_mass import FallingMass

MASS, GRAVITY, APPROACH = 1.0, 9.81, 0.5
STIFFNESS = 1e6


def first_peak(law: ContactLaw, tolerance: float) -> float:
    """Of a mass that meets the floor at APPROACH; `tolerance` of that speed and of a millimetre."""
    # From 1e-9 m above the floor, which changes the approach by 4e-8 of itself.
    y = np.array([1e-9, -APPROACH, 0.0])
    limits = StepLimits(tolerance * np.array([1e-3, APPROACH, 1.0]), 1e-2, 1e-14, 1e-5, 0.01, 1e-12, 10**5)
    run = Simulation(falling_mass.run, FallingMass(MASS, GRAVITY, law), y, 1, 3, limits, 0.05)
    ended = run.advance(2).episodes
    # A strongly damped mass stays on the floor.
    return float((ended if len(ended) else run.open_episodes)[0, PEAK])


# The speed errs by some tolerances; the peak by 1.2 times as much (Hertz) or as much (linear).
@pytest.mark.parametrize("tolerance", [1e-3, 3e-4, 1e-4, 1e-5, 1e-6])
def test_hertz(tolerance: float) -> None:
    energy = 0.5 * MASS * APPROACH**2
    deepest = brentq(lambda d: STIFFNESS * d**2.5 / 2.5 - MASS * GRAVITY * d - energy, 1e-6, 1.0, xtol=1e-15)
    assert first_peak(hertz(STIFFNESS), tolerance) == pytest.approx(
        STIFFNESS * deepest**1.5, rel=3 * tolerance + 1e-7
    )


@pytest.mark.parametrize("damping_ratio", [0.05, 0.3])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-6])
def test_spring_and_damper(damping_ratio: float, tolerance: float) -> None:
    omega = np.sqrt(STIFFNESS / MASS)
    damped = omega * np.sqrt(1 - damping_ratio**2)
    law = linear(STIFFNESS, 2 * damping_ratio * omega * MASS)
    # m d'' = m g - F with d' = APPROACH at d = 0, about the depth of rest m g / k.
    rest = MASS * GRAVITY / STIFFNESS
    t = np.linspace(0.0, np.pi / damped, 200_001)
    sine = (APPROACH - damping_ratio * omega * rest) / damped
    turn = np.exp(-damping_ratio * omega * t)
    d = rest + turn * (sine * np.sin(damped * t) - rest * np.cos(damped * t))
    force = STIFFNESS * d + law.damping * np.gradient(d, t, edge_order=2)
    assert first_peak(law, tolerance) == pytest.approx(force.max(), rel=3 * tolerance + 1e-7)


def test_force_that_is_largest_at_the_onset() -> None:
    law = linear(STIFFNESS, 4 * np.sqrt(STIFFNESS * MASS))
    # Twice the critical damping: from c v on the force only falls. An onset is found within 1e-12 m.
    assert first_peak(law, 1e-4) == pytest.approx(law.damping * APPROACH, rel=1e-6)
