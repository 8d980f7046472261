"""The space of fingerprints: moments of distributions, a healthy rig's scatter as the unit."""

from __future__ import annotations

import numpy as np
import pytest

from sim_twin.diagnosis.fingerprint import SLICES, Cell, Layout, of_cycles
from sim_twin.diagnosis.space import Moments, Space, space_of

LAYOUT = Layout(
    (
        of_cycles(0, "a", "energy"),
        Cell(0, "a", "coherence", partner="b", tolerance=0.02),
        of_cycles(0, "b", "mean"),
        Cell(0, "b", "height", 2),
    )
)


def test_moments_are_means_then_spreads_then_what_is_no_distribution() -> None:
    numbers = np.arange(13, dtype=np.float32)
    features = Moments(LAYOUT)(numbers)
    fifths = np.linspace(-0.5, 0.5, SLICES)
    assert features == pytest.approx([2.0, 8.0, fifths @ numbers[:5], fifths @ numbers[6:11], 5, 11, 12])
    assert Moments(LAYOUT)(np.tile(numbers, (3, 4, 1))).shape == (3, 4, 7)
    # other programs differ in an energy's mean and spread and in a coherence, and compute the rest alike
    assert list(Moments(LAYOUT).tolerance > 0) == [True, False, True, False, True, False, False]


@pytest.mark.parametrize("name", ["energy", "rms", "peak", "crest", "coherence", "quadrature", "swing"])
def test_what_a_cell_is_called_and_how_many_numbers_it_has_mean_nothing(name: str) -> None:
    curve = Moments(Layout((Cell(0, "torque", name, SLICES),)))
    numbers = np.array([3.0, 1.0, 4.0, 1.0, 5.0])
    assert curve(numbers) == pytest.approx(numbers)
    assert not curve.tolerance.any()


def test_a_distribution_of_other_than_five_numbers_is_refused() -> None:
    with pytest.raises(ValueError, match="a distribution has 5 numbers, not 4"):
        Cell(0, "torque", "peak", 4, distribution=True)


def test_a_spread_of_five_fifths_of_a_bell_is_in_proportion_to_its_deviation() -> None:
    one = np.array([-1.4, -0.53, 0.0, 0.53, 1.4])
    single = Moments(Layout((of_cycles(0, "a", "mean"),)))
    assert single(4 * one + 3)[0] == pytest.approx(3.0)
    assert single(4 * one + 3)[1] == pytest.approx(4 * single(one)[1])


def test_healthy_scatter_is_about_the_unit_and_far_is_told_by_its_logarithm() -> None:
    rng = np.random.default_rng(1)
    healthy = 7 + np.array([0.1, 10.0, 0.0]) * rng.standard_normal((500, 3))
    space = space_of(healthy, np.zeros((0, 3)), np.zeros(3), 2)
    # the estimate of a deviation is taken a quarter too large rather than too small
    assert np.std(space.scaled(healthy)[:, :2], axis=0) == pytest.approx([0.8, 0.8])
    assert not space.scaled(healthy)[:, 2].any()
    far = space.centre + np.outer([1.0, 5.0, 50.0, -50.0], [space.scale[0], 0.0, 0.0])
    x = space.scaled(far)[:, 0]
    assert x == pytest.approx([1.0, 5.0, 5 * (1 + np.log(10)), -5 * (1 + np.log(10))])


def test_a_tolerance_is_the_least_scatter() -> None:
    healthy = 0.001 * np.random.default_rng(2).standard_normal((200, 2))
    space = space_of(healthy, np.zeros((0, 2)), np.array([0.05, 0.0]), 1)
    assert space.scale == pytest.approx([0.05, 1.25 * healthy[:, 1].std()], rel=1e-3)


@pytest.mark.parametrize("count", [30, 200], ids=["fewer than features", "more than features"])
def test_directions_are_those_in_which_fingerprints_differ(count: int) -> None:
    rng = np.random.default_rng(3)
    healthy = rng.standard_normal((count, 60))
    response = np.zeros((count, 60))
    response[:, 7] = rng.uniform(10, 20, count)
    space = space_of(healthy, healthy + response, np.zeros(60), 4)
    assert space.basis.T @ space.basis == pytest.approx(np.eye(4), abs=1e-6)
    assert np.abs(space.basis[7]).max() > 0.95
    far = space.centre + 20 * np.eye(60)
    # what lies along the response lies in the directions, what lies beside it does not
    assert space.outside(far[7]) < 0.3 * space.outside(far[8])


def test_what_lies_in_no_direction_is_outside() -> None:
    space = Space(np.zeros(3), np.ones(3), np.eye(3)[:, :1])
    assert space(np.array([2.0, 3.0, 4.0])) == pytest.approx([2.0])
    assert space.outside(np.array([2.0, 3.0, 4.0])) == pytest.approx(np.sqrt((9 + 16) / 3))
    assert space.outside(np.array([2.0, 0.0, 0.0])) == 0


def test_one_fingerprint_far_away_does_not_take_the_directions_from_many() -> None:
    rng = np.random.default_rng(4)
    healthy = 0.1 * rng.standard_normal((100, 20))
    many, one = np.zeros((20, 20)), np.zeros((1, 20))
    many[:, 3], one[:, 11] = 1.0, 1e6
    space = space_of(healthy, np.concatenate([many, one]), np.zeros(20), 1)
    assert np.abs(space.basis[3, 0]) > np.abs(space.basis[11, 0])
