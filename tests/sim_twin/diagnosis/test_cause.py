"""Causes and their parameters: places in a cube and values are inverse, draws are what a rig may have."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Cause, allowed_by, drawn, named, parts_of, values_of
from sim_twin.effects import Parameter
from sim_twin.rigs.impact_beam.rig import MODEL as BEAM
from sim_twin.rigs.planar_slider_crank.rig import MODEL as CRANK
from sim_twin.rigs.planar_slider_crank.rig import MODEL as PLANAR

LINEAR = Parameter("mass", "kg", ((2.0, 5.0),))
WIDE = Parameter("corner", "Hz", ((0.3, 10.0),))
SPLIT = Parameter("gain", "", ((0.5, 0.92), (1.08, 2.0)))
EITHER_SIGN = Parameter("skew", "s", ((-2e-3, -5e-5), (5e-5, 2e-3)))
ANGLE = Parameter("phase", "rad", ((-100.0, 100.0),))
ORDER = Parameter("order", "", ((1.0, 4.0),), whole=True)
RNG_SEED = 3


def cause(*parameters: Parameter, name: str = "one") -> Cause:
    return Cause(name, "beam", parameters)


def evenly(count: int) -> NDArray[np.float64]:
    return ((np.arange(count) + 0.5) / count)[:, None]


@pytest.mark.parametrize("parameter", [LINEAR, WIDE, SPLIT, EITHER_SIGN, ANGLE], ids=lambda p: p.name)
def test_places_are_the_inverse_of_values(parameter: Parameter) -> None:
    one, u = cause(parameter), evenly(401)
    assert one.places(one.values(u)) == pytest.approx(u, abs=1e-12)


@pytest.mark.parametrize("parameter", [LINEAR, WIDE, SPLIT, EITHER_SIGN, ORDER], ids=lambda p: p.name)
def test_values_lie_in_the_intervals_and_reach_their_ends(parameter: Parameter) -> None:
    values = cause(parameter).values(evenly(100_001))[:, 0]
    inside = [(values >= low - 1e-12) & (values <= high + 1e-12) for low, high in parameter.intervals]
    assert np.any(inside, axis=0).all()
    for (low, high), here in zip(parameter.intervals, inside, strict=True):
        # 1e-5 of the cube, over a range whose ends differ by a factor of 40 at most
        assert values[here].min() == pytest.approx(low, abs=1e-3 * (high - low))
        assert values[here].max() == pytest.approx(high, abs=1e-3 * (high - low))


def test_an_angle_is_searched_in_one_turn_and_seen_as_a_point_on_a_circle() -> None:
    one = cause(ANGLE)
    values = one.values(evenly(1000))
    assert (values.min(), values.max()) == pytest.approx((-pi, pi), abs=0.01)
    assert one.coordinates(np.array([[-pi], [pi]]))[0] == pytest.approx(
        one.coordinates(np.array([[pi]]))[0], abs=1e-12
    )


def test_an_order_is_whole_and_each_as_likely() -> None:
    values = cause(ORDER).values(evenly(4000))[:, 0]
    numbers, counts = np.unique(values, return_counts=True)
    assert list(numbers) == [1, 2, 3, 4]
    assert list(counts) == [1000] * 4
    assert list(cause(ORDER).values(cause(ORDER).places(numbers[:, None]))[:, 0]) == [1, 2, 3, 4]


def test_a_wide_range_is_even_in_its_logarithm_and_a_narrow_one_in_itself() -> None:
    middle = np.array([[0.5]])
    assert cause(WIDE).values(middle)[0, 0] == pytest.approx(np.sqrt(0.3 * 10))
    assert cause(LINEAR).values(middle)[0, 0] == pytest.approx(3.5)


def test_coordinates_of_a_skew_rise_with_it_through_both_signs() -> None:
    values = np.array([[-2e-3], [-5e-5], [5e-5], [2e-3]])
    column = cause(EITHER_SIGN).coordinates(values)[:, 0]
    assert np.all(np.diff(column) > 0)
    assert column == pytest.approx(-column[::-1])


def test_a_value_outside_the_intervals_gets_the_place_of_the_nearest_one() -> None:
    places = cause(SPLIT).places(np.array([[0.1], [0.95], [1.05], [9.0]]))[:, 0]
    assert places == pytest.approx([0.0, 0.5, 0.5, 1.0])


def test_draws_of_a_hypothesis_are_spread_evenly_over_its_cube() -> None:
    pair = (cause(LINEAR, SPLIT, name="a"), cause(WIDE, name="b"))
    values = drawn(pair, 50, np.random.default_rng(RNG_SEED))
    assert values.shape == (50, 3)
    for one, part in zip(pair, parts_of(pair), strict=True):
        places = one.places(values[:, part])
        # one in each of 50 slices, of each parameter
        assert np.array_equal(np.sort(places * 50 // 1, axis=0)[:, 0], np.arange(50))


def test_draws_keep_to_what_may_go_together() -> None:
    distortion = BEAM.effects["drive_distortion"]
    one = Cause(
        "drive_distortion",
        "drive",
        distortion.parameters,
        allows=lambda given: not distortion.together(given),
    )
    values = drawn((one,), 400, np.random.default_rng(RNG_SEED))
    assert len(values) == 400
    assert allowed_by((one,), values).all()
    assert values.max(axis=1).min() >= 0.04
    assert not allowed_by((one,), np.array([[0.01, 0.03]])).any()


def test_what_is_never_allowed_is_an_error() -> None:
    never = Cause("never", "beam", (LINEAR, WIDE), allows=lambda _: False)
    with pytest.raises(ValueError, match="hardly any parameters of never"):
        drawn((never,), 3, np.random.default_rng(RNG_SEED))


def test_nothing_has_no_parameters_and_is_allowed() -> None:
    values = values_of((), np.zeros((7, 0)))
    assert values.shape == (7, 0)
    assert allowed_by((), values).all()
    assert named((), values[0]) == ()


def test_a_cause_on_a_channel_is_named_with_it() -> None:
    on = Cause("sensor_gain", "sensor", (SPLIT,), "yoke.force", sensing=True)
    pair = (cause(LINEAR, WIDE, name="a"), on)
    assert named(pair, np.array([3.0, 1.0, 1.5])) == (
        ("a", {"mass": 3.0, "corner": 1.0}),
        ("sensor_gain", {"channel": "yoke.force", "gain": 1.5}),
    )


@pytest.mark.parametrize("model", [BEAM, CRANK], ids=lambda model: model.name)
def test_values_of_every_catalogued_effect_pass_its_own_check(model: object) -> None:
    for effect in (BEAM if model is BEAM else CRANK).effects.values():
        one = Cause(
            effect.name,
            effect.location,
            effect.parameters,
            allows=lambda given, effect=effect: not effect.together(given),  # type: ignore[misc]
        )
        for row in drawn((one,), 40, np.random.default_rng(RNG_SEED)):
            for parameter, value in zip(effect.parameters, row, strict=True):
                assert parameter.holds(float(value))


def test_a_fluctuating_speed_is_straight_in_the_waves_of_its_order() -> None:
    effect = PLANAR.effects["speed_fluctuation"]
    cause = Cause(effect.name, effect.location, effect.parameters, nearly_straight=effect.coordinates)
    values = np.array([[0.01, 2.0, 0.3], [0.02, 2.0, 0.3], [0.01, 3.0, 0.3], [0.01, 2.0, 0.3 + np.pi]])
    once, twice, other, opposite = cause.coordinates(values)
    assert once[2:4] == pytest.approx([0.01 * np.cos(0.3), 0.01 * np.sin(0.3)])
    assert np.count_nonzero(once) == 2
    assert twice == pytest.approx(2 * once)
    assert opposite == pytest.approx(-once)
    assert once @ other == 0.0
