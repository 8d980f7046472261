"""Slider with clearance in its guide: the published motion, and another program on into contact."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_twin.mechanisms.run import APPROACH, ONSET, PEAK, StepLimits
from sim_twin.mechanisms.simulation import Simulation
from tests.sim_twin.mechanisms import guided_slider_crank as mechanism

START = np.array([0.0, 0.0, 0.0, 150.0, -75.0, 0.0, 0.0])
FIRST_CONTACT = 2.692503e-3
TIGHT = StepLimits(1e-11 * np.array([1, 1, 1, 100, 100, 100, 1]), 1e-4, 1e-16, 1e-6, 1e-3, 1e-12, 10**6)
K = 1e8


def simulation(step: float) -> Simulation[mechanism.GuidedSliderCrank]:
    p = mechanism.flores_leine_glocker(K)
    return Simulation(mechanism.run, p, START, 4, mechanism.OUTPUTS, TIGHT, step)


@pytest.mark.long
def test_before_the_first_contact() -> None:
    # Reference: a solution at 1e-12, printed with seven digits, so half a unit of the last one.
    outputs = simulation(1e-3).advance(2).outputs
    assert outputs[3, 1] == pytest.approx(139.1159, abs=5e-5)
    assert outputs[4, 1] == pytest.approx(-68.2763, abs=5e-5)


def test_first_contact() -> None:
    episodes = simulation(1e-3).advance(5).episodes
    assert episodes[0, ONSET] == pytest.approx(FIRST_CONTACT, abs=5e-10)
    outputs = simulation(FIRST_CONTACT).advance(2).outputs
    assert outputs[3, 1] == pytest.approx(109.5577, abs=1e-4)  # 2e-9 s off at 3e4 rad/s2
    assert outputs[4, 1] == pytest.approx(-49.3308, abs=1e-4)


BODIES = ((0.038, 7.4e-5), (0.038, 5.9e-4), (0.076, 2.7e-6))
L1, L2, A, B, C = 0.153, 0.306, 0.05, 0.025, 0.001


def jacobians(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How the three bodies' centres move with the angles, and the accelerations left at zero q''."""
    (s1, s2, _), (c1, c2, _) = np.sin(q), np.cos(q)
    u, w = np.array([-s1, c1]), np.array([-s2, c2])
    zero = np.zeros(2)
    first = np.array([L1 / 2 * u, zero, zero]).T
    second = np.array([L1 * u, L2 / 2 * w, zero]).T
    third = np.array([L1 * u, L2 * w, zero]).T
    inward1, inward2 = -np.array([c1, s1]), -np.array([c2, s2])
    return np.array([first, second, third]), np.array(
        [[L1 / 2 * inward1, zero], [L1 * inward1, L2 / 2 * inward2], [L1 * inward1, L2 * inward2]]
    )


def independent_rate(t: float, z: np.ndarray, v0: np.ndarray) -> np.ndarray:
    q, v = z[:3], z[3:]
    J, inward = jacobians(q)
    M, f = np.diag([J_ for _, J_ in BODIES]), np.zeros(3)
    for i, (mass, _) in enumerate(BODIES):
        M += mass * J[i].T @ J[i]
        f += J[i].T @ (mass * np.array([0, -9.81]) - mass * (inward[i].T @ v[:2] ** 2))
    R = np.array([[np.cos(q[2]), -np.sin(q[2])], [np.sin(q[2]), np.cos(q[2])]])
    centre = np.array([0.0, L1 * np.sin(q[0]) + L2 * np.sin(q[1])])
    for k, (x, y) in enumerate(((-A, B), (A, B), (-A, -B), (A, -B))):
        arm = R @ np.array([x, y])
        rows = J[2].copy()
        rows[:, 2] = [-arm[1], arm[0]]
        speed, side = rows @ v, np.sign(y)
        d, rate = side * (centre + arm)[1] - B - C, side * speed[1]
        if v0[k] > 0 and d > 0:
            normal = max(0.0, K * d**1.5 * (1 + 0.75 * (1 - 0.4**2) * rate / v0[k]))
            drag = 0.01 * np.clip((abs(speed[0]) - 1e-4) / 9e-4, 0, 1) * np.sign(speed[0])
            f += rows.T @ np.array([-drag * normal, -side * normal])
    return np.concatenate([v, np.linalg.solve(M, f)])


def test_into_the_contact_like_another_program() -> None:
    end = 3.2e-3

    def touches(_: float, z: np.ndarray, v0: np.ndarray) -> float:
        return float(L1 * np.sin(z[0]) + L2 * np.sin(z[1]) - C)

    touches.terminal, touches.direction = True, 1.0  # type: ignore[attr-defined]
    settings = {"rtol": 1e-10, "atol": 1e-12}
    flight = solve_ivp(
        independent_rate, (0, end), START[:6], "DOP853", events=touches, args=(np.zeros(4),), **settings
    )
    z = flight.y[:, -1]
    approach = L1 * np.cos(z[0]) * z[3] + L2 * np.cos(z[1]) * z[4]
    v0 = np.array([approach, approach, 0, 0])
    contact = solve_ivp(
        independent_rate, (flight.t[-1], end), z, "DOP853", args=(v0,), max_step=5e-6, **settings
    )
    run = simulation(end / 100)
    outputs = run.advance(101).outputs
    assert run.open_episodes[0, APPROACH] == pytest.approx(approach, rel=1e-8)
    assert run.open_episodes[0, PEAK] > 100
    # Rates of 100 rad/s; the contact turns an error of the approach into about as large a one.
    np.testing.assert_allclose(outputs[3:, -1], contact.y[3:, -1], rtol=1e-6, atol=1e-5)
