"""Contact laws, measured by a mass that hits a floor."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_twin.contact import (
    ContactLaw,
    Friction,
    contact_forces,
    friction_share,
    hertz,
    lankarani_nikravesh,
    linear,
)
from sim_twin.mechanisms.run import APPROACH, ONSET, PEAK, StepLimits
from sim_twin.mechanisms.simulation import Simulation
from tests.sim_twin.mechanisms import falling_mass
from tests.sim_twin.mechanisms.falling_mass import FallingMass

MASS, SPEED, K = 1.5, 0.4, 5e10
TIGHT = StepLimits(1e-12 * np.array([1e-3, 1.0, 1.0]), 1e-4, 1e-16, 1e-7, 0.01, 1e-13, 10**6)


def impact(law: ContactLaw) -> tuple[float, float, float, float]:
    """Onset s, peak N, speed after over speed before, and energy lost in J of one impact without gravity."""
    run = Simulation(
        falling_mass.run, FallingMass(MASS, 0.0, law), np.array([1e-5, -SPEED, 0.0]), 1, 3, TIGHT, 1e-3
    )
    trace = run.advance(3)
    (episode,) = trace.episodes
    assert episode[APPROACH] == pytest.approx(SPEED, rel=1e-12)
    return (
        float(episode[ONSET]),
        float(episode[PEAK]),
        float(trace.outputs[1, 2]) / SPEED,
        float(run.state[2]),
    )


def test_hertz_has_its_closed_form() -> None:
    onset, peak, restitution, lost = impact(hertz(K))
    assert onset == pytest.approx(1e-5 / SPEED, abs=TIGHT.reach / SPEED)
    # Energy: K d^2.5 / 2.5 = m v^2 / 2. The peak is a parabola's over steps of a hundredth of the contact.
    deepest = (1.25 * MASS * SPEED**2 / K) ** 0.4
    assert peak == pytest.approx(K * deepest**1.5, rel=2e-5)
    assert restitution == pytest.approx(1.0, abs=1e-9)
    assert lost == 0.0


def test_linear_spring_and_damper_have_their_closed_form() -> None:
    k, c = 1.4e7, 51.0
    _, peak, restitution, lost = impact(linear(k, c))
    omega, decay = np.sqrt(k / MASS), c / (2 * MASS)
    damped = np.sqrt(omega**2 - decay**2)
    # No pull: it ends where k d + c d' = 0, and the mass leaves faster than it would at d = 0.
    t = (np.pi - np.arctan2(2 * decay * damped, omega**2 - 2 * decay**2)) / damped
    t = t if t > 0 else t + np.pi / damped
    leaves = np.exp(-decay * t) * (np.cos(damped * t) - decay / damped * np.sin(damped * t))
    assert restitution == pytest.approx(-leaves, rel=1e-6)
    assert lost > 0
    top = (np.arctan2(2 * decay * damped, omega**2 - 2 * decay**2)) / damped
    times = np.linspace(0, np.pi / damped, 20001)
    d = SPEED / damped * np.exp(-decay * times) * np.sin(damped * times)
    rate = np.gradient(d, times)
    assert peak == pytest.approx((k * d + c * rate).max(), rel=1e-4)
    assert top > 0


@pytest.mark.parametrize("e", [0.7, 0.9, 0.99])
def test_a_damped_law_agrees_with_scipy_and_balances_its_energy(e: float) -> None:
    _, peak, restitution, lost = impact(lankarani_nikravesh(K, e))
    chi = 0.75 * (1 - e**2)

    def force(z: np.ndarray) -> float:
        return float(K * max(z[0], 0.0) ** 1.5 * (1 + chi * z[1] / SPEED))

    def leaves(_: float, z: np.ndarray) -> float:
        return float(z[0])

    leaves.terminal, leaves.direction = True, -1.0  # type: ignore[attr-defined]
    found = solve_ivp(
        lambda _, z: [z[1], -force(z) / MASS], (0, 0.01), [0.0, SPEED], "DOP853", events=leaves,
        rtol=1e-11, atol=1e-15, max_step=2e-7,
    )  # fmt: skip
    assert restitution == pytest.approx(-found.y[1, -1] / SPEED, rel=1e-6)
    assert peak == pytest.approx(max(force(z) for z in found.y.T), rel=2e-5)
    assert lost == pytest.approx(0.5 * MASS * SPEED**2 * (1 - restitution**2), rel=1e-6)
    # The law is made for e near 1, where it gives it: the error is of second order in 1 - e.
    assert restitution == pytest.approx(e, abs=1.5 * (1 - e) ** 2)


def test_no_law_pulls() -> None:
    for law in (linear(1e7, 100.0), lankarani_nikravesh(K, 0.1)):
        assert contact_forces(law, 1e-6, -100.0, 0.01)[0] == 0.0
        assert contact_forces(law, -1e-6, 1.0, 0.01) == (0.0, 0.0)
        assert contact_forces(law, 1e-6, 1.0, 0.0) == (0.0, 0.0)  # it is open


def test_friction_sets_in_between_its_two_speeds() -> None:
    friction = Friction(0.3, 1e-4, 1e-3)
    assert friction_share(friction, 0.9e-4) == 0.0
    assert friction_share(friction, 5.5e-4) == pytest.approx(-0.15)
    assert friction_share(friction, 2.0) == -0.3
    assert friction_share(friction, -2.0) == 0.3
