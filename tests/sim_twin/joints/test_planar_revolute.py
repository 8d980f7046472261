"""The planar revolute joint with clearance."""

from __future__ import annotations

import numpy as np
import pytest

from sim_twin.contact import Friction, lankarani_nikravesh
from sim_twin.joints.planar_revolute import (
    RevoluteClearance,
    revolute_depth,
    revolute_force,
)

JOINT = RevoluteClearance(1e-3, 10e-3, lankarani_nikravesh(5e10, 0.9), Friction(0.2, 1e-4, 1e-3))


def test_depth_is_measured_along_the_eccentricity() -> None:
    d, rate = revolute_depth(1e-3, 0.6e-3, 0.8e-3 + 8e-6, 0.0, 1.0)
    assert d == pytest.approx(6.4e-6, rel=1e-2)
    assert rate == pytest.approx(0.8, rel=1e-2)
    assert revolute_depth(1e-3, 0.0, 0.0, 1.0, 1.0) == (-1e-3, 0.0)


def test_pushes_along_the_normal_and_drags_along_the_surface() -> None:
    angle, d = 0.7, 2e-6
    n, t = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    e, v = (1e-3 + d) * n, 0.05 * n + 0.3 * t
    force = revolute_force(JOINT, e[0], e[1], v[0], v[1], 0.0, 0.0, 0.1)
    normal = 5e10 * d**1.5 * (1 + 0.75 * 0.19 * 0.05 / 0.1)
    on_bearing = np.array([force.x, force.y])
    assert on_bearing @ n == pytest.approx(normal, rel=1e-6)  # d is 1e-13 of rounding beside e
    assert on_bearing @ t == pytest.approx(0.2 * normal, rel=1e-6)


def test_the_pair_loses_what_it_is_said_to_lose() -> None:
    # Power of both forces and moments on both bodies, against `lost` plus the rate of the stored energy.
    e, v, spins = np.array([0.8e-3, 0.605e-3]), np.array([0.02, -0.1]), (21.0, -5.0)
    force = revolute_force(JOINT, *e, *v, *spins, 0.1)
    d, rate = revolute_depth(1e-3, *e, *v)
    given = force.x * v[0] + force.y * v[1] - force.on_journal * spins[0] - force.on_bearing * spins[1]
    assert d > 0
    assert given == pytest.approx(force.lost + 5e10 * d**1.5 * rate, rel=1e-9)


def test_nothing_in_free_flight() -> None:
    assert revolute_force(JOINT, 0.5e-3, 0.0, 1.0, 1.0, 20.0, 0.0, 0.1) == (0.0,) * 6
