"""Spatial joints against geometry, statics and the planar joint."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from daq.errors import UnphysicalParameter
from sim_twin.contact.laws import ContactLaw, Friction, linear
from sim_twin.joints.planar_revolute import RevoluteClearance, revolute_force
from sim_twin.joints.spatial_prismatic import PrismaticJoint, face_axis, face_side, friction_force
from sim_twin.joints.spatial_revolute import Journal, RevoluteJoint, journal_load, journal_touch
from sim_twin.joints.spherical import SphericalJoint, ball_in_socket
from sim_twin.joints.stop import stop
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


def test_a_stop_pushes_back() -> None:
    touch = stop((0.2, 5.0, 0.0), (1.5, 9.0, 0.0), (0.1, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert touch == (pytest.approx(0.1), pytest.approx(1.0), (-1.0, 0.0, 0.0))


@pytest.mark.parametrize("clearance", [0.0, -1e-3, float("nan")])
def test_clearances_are_positive(clearance: float) -> None:
    with pytest.raises(UnphysicalParameter, match="clearance"):
        SphericalJoint(clearance, LAW)
    with pytest.raises(UnphysicalParameter, match="clearance"):
        PrismaticJoint(6.5e-3, clearance, 25e-3, 4e-3, LAW, FRICTION)
    with pytest.raises(UnphysicalParameter, match="clearance"):
        RevoluteJoint(clearance, 0.02, 1e-3, 0.01, LAW, FRICTION)


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


def journal(place: tuple, axis: tuple = (1.0, 0.0, 0.0), velocity: tuple = (0.0,) * 3,
            omega: tuple = (0.0,) * 3) -> Journal:  # fmt: skip
    return Journal(place, tuple(np.array(axis) / np.linalg.norm(axis)), velocity, omega)


class TestRevolute:
    joint = RevoluteJoint(0.1e-3, 0.04, 0.5e-3, 0.01, LAW, FRICTION)
    touching = np.full(4, 0.1)

    def test_an_untilted_journal_is_the_planar_joint_with_half_the_law_at_each_end(self) -> None:
        place, velocity, spin = (0.0, 0.08e-3, 0.07e-3), (0.0, 0.02, -0.01), 3.0
        joint = self.joint.numbers()
        halved = joint._replace(law=ContactLaw(LAW.stiffness / 2, 1.0, 0.0, LAW.damping / 2))
        force, moment = journal_load(halved, journal(place, (1.0, 0.0, 0.0), velocity, (spin, 0.0, 0.0)),
                                     self.touching)  # fmt: skip
        planar = RevoluteClearance(0.1e-3, 0.01, LAW, FRICTION)
        of_planar = revolute_force(planar, *place[1:], *velocity[1:], spin, 0.0, 0.1)
        assert force == pytest.approx((0.0, -of_planar.x, -of_planar.y), rel=1e-9)
        # The planar joint puts the contact at the bearing's surface, one overlap (6 um of 10 mm) further out.
        assert moment == pytest.approx((of_planar.on_journal, 0.0, 0.0), rel=1e-3, abs=1e-12)

    def test_ends_share_a_load_by_the_lever(self) -> None:
        # Depths of 3 and 1 um at -20 and +20 mm carry a load 10 mm before the middle.
        middle, slope = 0.1e-3 + 2e-6, -1e-6 / 0.02
        place = (0.0, 0.0, -middle)
        force, moment = journal_load(self.joint.numbers()._replace(friction=Friction(0.0, 0.0, 1.0)),
                                     journal(place, (1.0, 0.0, -slope)), self.touching)  # fmt: skip
        assert force == pytest.approx((0.0, 0.0, 40.0), rel=1e-6)
        assert moment[1] / force[2] == pytest.approx(0.01, rel=1e-6)

    def test_a_tilted_journal_touches_both_ends_on_opposite_sides(self) -> None:
        tilt = 2 * 0.101e-3 / 0.04
        both = [
            journal_touch(self.joint.numbers(), journal((0.0,) * 3, (1.0, tilt, 0.0)), end)[0]
            for end in (0, 1)
        ]
        assert [touch.depth for touch in both] == pytest.approx([1e-6, 1e-6], rel=1e-6)
        assert both[0].normal[1] == pytest.approx(1.0)
        assert both[1].normal[1] == pytest.approx(-1.0)

    @pytest.mark.parametrize("side", [1.0, -1.0])
    def test_shoulders_stop_the_axial_motion(self, side: float) -> None:
        force, moment = journal_load(
            self.joint.numbers(), journal((side * 0.501e-3, 0.0, 0.0)), self.touching
        )
        assert force == pytest.approx((-side * 10.0, 0.0, 0.0), rel=1e-6)
        assert moment == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)

    @pytest.mark.parametrize("contact", range(4))
    def test_depths_change_at_their_rates(self, contact: int) -> None:
        rng = np.random.default_rng(contact)
        place, velocity, omega = rng.normal(size=(3, 3)) * [[1e-4], [0.1], [2.0]]
        axis, h = np.array([1.0, 2e-3, -1e-3]) / sqrt(1 + 5e-6), 1e-7
        depths = []
        for t in (-h, h):
            moved = Journal(
                tuple(place + t * velocity), tuple(axis + t * np.cross(omega, axis)), (0.0,) * 3, (0.0,) * 3
            )
            depths.append(journal_touch(self.joint.numbers(), moved, contact)[0].depth)
        moving = Journal(tuple(place), tuple(axis), tuple(velocity), tuple(omega))
        now, _ = journal_touch(self.joint.numbers(), moving,
                               contact)  # fmt: skip
        assert now.rate == pytest.approx((depths[1] - depths[0]) / (2 * h), abs=1e-6)

    def test_contacts_that_are_not_latched_exert_nothing(self) -> None:
        assert journal_load(self.joint.numbers(), journal((0.0, 1e-3, 0.0)), np.zeros(4)) == (
            (0.0,) * 3,
            (0.0,) * 3,
        )


def test_gibbs_vector_turns_as_its_angular_velocity_says() -> None:
    rng = np.random.default_rng(3)
    g, omega = rng.normal(size=(2, 3)) * 0.3
    h, rate = 1e-6, np.array(gibbs_rate(tuple(g), tuple(omega)))
    before, now, after = (np.array(gibbs_rotation(tuple(g + t * rate))) for t in (-h, 0.0, h))
    skew = now.T @ (after - before) / (2 * h)
    assert now @ now.T == pytest.approx(np.eye(3), abs=1e-15)
    assert (skew[2, 1], skew[0, 2], skew[1, 0]) == pytest.approx(omega, abs=1e-9)
