"""The library: what was ordered comes back as cases of what was asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Cause, Hypothesis
from sim_twin.diagnosis.library import Library, order_of
from sim_twin.diagnosis.subject import Draw, Observed
from sim_twin.effects import Parameter

SCALE = Parameter("scale", "", ((0.0, 10.0),))
MOVING = Cause("moving", "beam", (SCALE,))
GAIN = Cause("gain", "sensor", (SCALE,), "a", sensing=True)
SKEW = Cause("skew", "clock", (SCALE,), "b", sensing=True)


def rows(*values: float) -> NDArray[np.float64]:
    return np.array(values)[:, None]


def told(draws: Sequence[Draw]) -> list[Observed]:
    """A fingerprint that tells what was in the draw: sums of the effects' scales, twice a block."""
    return [
        tuple(
            np.full((draw.blocks, 2), sum(float(v["scale"]) for _, v in (*draw.effects, *extra)), np.float32)
            for extra in draw.sensing
        )
        for draw in draws
    ]


def test_every_row_is_observed_once_with_its_own_values() -> None:
    pair: Hypothesis = (GAIN, MOVING)
    cases: dict[Hypothesis, NDArray[np.float64]] = {
        (): np.zeros((3, 0)),
        (MOVING,): rows(1, 2),
        (GAIN,): rows(3, 4, 5, 6),
        pair: np.array([[1.0, 7.0]]),
    }
    library = Library()
    order = order_of(cases, np.random.default_rng(1))
    library.add(order, told(order.draws))
    assert {h: library.count(h) for h in cases} == {(): 3, (MOVING,): 2, (GAIN,): 4, pair: 1}
    assert library.count((SKEW,)) == 0
    assert set(library.hypotheses) == set(cases)
    assert library.observations == 10
    for hypothesis in ((MOVING,), (GAIN,), pair):
        shown = [each[0, 0] for each in library.fingerprints(hypothesis)]
        assert shown == list(library.values(hypothesis).sum(axis=1))
    assert sorted(library.values((GAIN,))[:, 0]) == [3, 4, 5, 6]


def test_effects_of_sensors_share_motions_and_others_have_their_own() -> None:
    cases: dict[Hypothesis, NDArray[np.float64]] = {
        (MOVING,): rows(1, 2),
        (GAIN,): rows(*range(7)),
        (SKEW,): rows(*range(6)),
        (GAIN, SKEW): np.ones((1, 2)),
        (GAIN, MOVING): np.ones((2, 2)),
    }
    order = order_of(cases, np.random.default_rng(2), together=6)
    # 14 cases of sensors, three a motion so that four motions have most of them; the other four one each
    assert len(order) == 5 + 4
    assert sorted(len(draw.sensing) for draw in order.draws) == [1, 1, 1, 1, 2, 3, 3, 3, 3]
    assert all(not draw.effects for draw in order.draws if len(draw.sensing) > 1)
    shared = next(draw for draw in order.draws if len(draw.effects) == 1 and draw.sensing != ((),))
    assert (shared.effects, shared.sensing) == (
        (("moving", {"scale": 1.0}),),
        ((("gain", {"channel": "a", "scale": 1.0}),),),
    )


def test_every_motion_has_a_seed_of_its_own_and_the_same_order_comes_from_the_same_seed() -> None:
    cases: dict[Hypothesis, NDArray[np.float64]] = {(): np.zeros((50, 0)), (GAIN,): rows(*range(50))}
    one, other = (order_of(cases, np.random.default_rng(3), blocks=2) for _ in range(2))
    assert len({draw.seed for draw in one.draws}) == len(one)
    assert [draw.seed for draw in one.draws] == [draw.seed for draw in other.draws]
    assert {draw.blocks for draw in one.draws} == {2}


def test_what_failed_is_counted_and_what_there_was_no_time_for_is_not() -> None:
    library = Library()
    order = order_of({(): np.zeros((3, 0)), (GAIN,): rows(1, 2)}, np.random.default_rng(4))
    shown = told(order.draws)
    shown[0], shown[1] = (None,), ()
    shown[3] = (None, *shown[3][1:])
    library.add(order, shown)
    assert (library.count(()), library.count((GAIN,)), library.failed) == (1, 1, 2)
    assert library.observations == 2


def test_an_observation_too_few_is_an_error() -> None:
    order = order_of({(GAIN,): rows(1, 2)}, np.random.default_rng(5))
    with pytest.raises(ValueError, match="shorter"):
        Library().add(order, [told(order.draws)[0][:1]])


def test_orders_add_up() -> None:
    rng = np.random.default_rng(6)
    one, other = order_of({(): np.zeros((2, 0))}, rng), order_of({(MOVING,): rows(1)}, rng)
    both = one + other
    assert both.draws == one.draws + other.draws
    assert len(both) == len(both.cases) == 3
