"""Spatial joints against geometry."""

from __future__ import annotations

import numpy as np
import pytest

from daq.errors import UnphysicalParameter
from sim_twin.contact import Friction, linear
from sim_twin.joints.spatial import (
    PrismaticJoint,
    SphericalJoint,
    ball_in_socket,
    face_axis,
    face_side,
    friction_force,
)
from sim_twin.joints.vectors import gibbs_rate, gibbs_rotation

FRICTION = Friction(0.1, 1e-4, 1e-3)
LAW = linear(1e7, 50.0)
# Differences over 1e-7 s of places of 0.1 m: rounding 1e-16 / 1e-7, second order 1e-14.
RATE_ERROR = 1e-7


def test_a_ball_overlaps_by_what_its_offset_exceeds_the_clearance() -> None:
    touch = ball_in_socket((1.0003, 2.0, 3.0004), (0.0,) * 3, (1.0, 2.0, 3.0), (0.0,) * 3, 0.4e-3)
    assert touch.depth == pytest.approx(0.1e-3, abs=1e-15)
    assert touch.normal == pytest.approx((-0.6, 0.0, -0.8), abs=1e-12)


def test_the_overlap_of_a_ball_changes_at_its_rate() -> None:
    rng = np.random.default_rng(1)
    place, velocity, socket = rng.normal(size=(3, 3)) * 1e-3
    h = 1e-7
    at = [ball_in_socket(tuple(place + t * velocity), tuple(velocity), tuple(t * socket), tuple(socket), 1e-4)
          for t in (-h, 0.0, h)]  # fmt: skip
    assert at[1].rate == pytest.approx((at[2].depth - at[0].depth) / (2 * h), abs=RATE_ERROR)


def test_a_centred_ball_is_free() -> None:
    touch = ball_in_socket((0.0,) * 3, (1.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3, 1e-4)
    assert touch == (-1e-4, 0.0, pytest.approx((0.0, 0.0, 0.0)))


@pytest.mark.parametrize("clearance", [-1e-3, float("nan")])
def test_clearances_are_positive(clearance: float) -> None:
    with pytest.raises(UnphysicalParameter, match="clearance"):
        SphericalJoint(clearance, LAW)
    with pytest.raises(UnphysicalParameter, match="clearance"):
        PrismaticJoint(6.5e-3, clearance, 25e-3, 4e-3, LAW, FRICTION)


class TestPrismatic:
    joint = PrismaticJoint(6.5e-3, 0.25e-3, 25e-3, 4e-3, LAW, FRICTION)

    def depths(self, place: np.ndarray, g: np.ndarray) -> np.ndarray:
        points = place + self.joint.points() @ np.array(gibbs_rotation(tuple(g))).T
        return np.array([6.5e-3 - face_side(i) * points[i, face_axis(i)] for i in range(8)])

    def test_a_centred_shell_has_its_clearance_at_all_points(self) -> None:
        assert self.depths(np.zeros(3), np.zeros(3)) == pytest.approx(-0.25e-3, abs=1e-15)

    def test_points_lie_as_the_channels_say(self) -> None:
        points = self.joint.points()
        assert [face_axis(i) for i in range(8)] == [1, 1, 2, 2, 1, 1, 2, 2]
        assert list(points[:, 0]) == [-25e-3] * 4 + [25e-3] * 4
        for i in range(8):
            assert face_side(i) * points[i, face_axis(i)] == pytest.approx(6.75e-3)

    def test_a_dropped_shell_rests_on_its_upper_points(self) -> None:
        depths = self.depths(np.array([0.0, 0.0, -0.26e-3]), np.zeros(3))
        assert list(np.flatnonzero(depths > 0)) == [2, 6]

    @pytest.mark.parametrize("roll", [-0.08, 0.08])
    def test_either_way_of_rolling_is_stopped(self, roll: float) -> None:
        touching = np.flatnonzero(self.depths(np.zeros(3), np.array([roll / 2, 0.0, 0.0])) > 0)
        assert list(touching) == ([0, 1] if roll > 0 else [4, 5])

    def test_never_more_than_six_touch(self) -> None:
        rng = np.random.default_rng(2)
        places, turns = rng.normal(size=(2, 4000, 3)) * [[[0, 3e-4, 3e-4]], [[0.03, 0.01, 0.01]]]
        counts = [np.count_nonzero(self.depths(p, g) > 0) for p, g in zip(places, turns, strict=True)]
        assert min(counts) == 0
        assert 4 <= max(counts) <= 6

    def test_friction_opposes_sliding_and_is_mu_n(self) -> None:
        force = friction_force(FRICTION, 20.0, 1, (0.3, 7.0, -0.4))
        assert force == pytest.approx((-2.0 * 0.6, 0.0, 2.0 * 0.8))
        assert friction_force(FRICTION, 20.0, 2, (0.3, -0.4, 7.0)) == pytest.approx((-1.2, 1.6, 0.0))

    def test_friction_sets_in_between_its_two_speeds(self) -> None:
        assert friction_force(FRICTION, 20.0, 1, (0.9e-4, 0.0, 0.0)) == (0.0, 0.0, 0.0)
        assert friction_force(FRICTION, 20.0, 1, (5.5e-4, 0.0, 0.0))[0] == pytest.approx(-1.0)


def test_gibbs_vector_turns_as_its_angular_velocity_says() -> None:
    rng = np.random.default_rng(3)
    g, omega = rng.normal(size=(2, 3)) * 0.3
    h, rate = 1e-6, np.array(gibbs_rate(tuple(g), tuple(omega)))
    before, now, after = (np.array(gibbs_rotation(tuple(g + t * rate))) for t in (-h, 0.0, h))
    skew = now.T @ (after - before) / (2 * h)
    assert now @ now.T == pytest.approx(np.eye(3), abs=1e-15)
    assert (skew[2, 1], skew[0, 2], skew[1, 0]) == pytest.approx(omega, abs=1e-9)
