"""About the best explanation its parameters are found better than from the healthy twin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from sim_twin.diagnosis.cause import Cause, Hypothesis
from sim_twin.diagnosis.library import Library
from sim_twin.diagnosis.posterior import Posterior
from sim_twin.diagnosis.refocus import Focus, refocused
from sim_twin.diagnosis.search import Ranked
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.subject import Draw, Observed
from sim_twin.effects import Parameter
from tests.sim_twin.diagnosis.toy import BLOCKS, GAIN, LEFT, RIGHT, Blocks, Toy, recording, response

TOY = Toy()
RIG = 10**6
MOMENTS = Moments(TOY.layout)
RIGS = 32


def believed(hypothesis: Hypothesis, *about: float, deviation: float = 0.08) -> Ranked:
    """A posterior about places of the unit cube, as a search leaves it."""
    rng = np.random.default_rng(1)
    places = np.clip(np.array(about) + deviation * rng.standard_normal((400, len(about))), 0.0, 0.999)
    return Ranked(hypothesis, 1.0, Posterior(places, np.full(400, 1 / 400), 0.0), 0.5)


def about(ranked: Ranked, measured: Blocks, seed: int = 0) -> tuple[Ranked, Focus | None]:
    rng = np.random.default_rng(seed)
    return refocused(ranked, measured, MOMENTS, [float(len(measured))], RIGS, TOY.observe, rng, Library())


@pytest.mark.parametrize("seed", range(3))
def test_a_size_that_the_search_was_off_by_is_found(seed: int) -> None:
    # of 0.8 on a logarithm from 1 to 4: 3.0; the search believes 2.6
    measured = recording((("left", {"size": 3.0}),), RIG + seed)
    ranked, focus = about(believed((LEFT,), np.log(2.6) / np.log(4)), measured, seed)
    assert focus is not None
    [size] = ranked.estimates()
    # its own scatter is 0.07, see `test_search`; and slopes are known from some thirty rigs
    assert size.value == pytest.approx(3.0, abs=0.3)
    assert size.low < 3.0 < size.high
    assert size.high - size.low < 1.0


def test_sizes_of_a_pair_far_from_the_healthy_twin_are_both_found() -> None:
    measured = recording((("left", {"size": 3.5}), ("right", {"size": 6.0})), RIG)
    places = np.log(3.2) / np.log(4), np.log(5.2 / 0.5) / np.log(16)
    ranked, focus = about(believed((LEFT, RIGHT), *places, deviation=0.05), measured)
    assert focus is not None
    left, right = ranked.estimates()
    assert left.value == pytest.approx(3.5, abs=0.3)
    assert right.value == pytest.approx(6.0, abs=0.3)


def test_intervals_hold_the_truth() -> None:
    held = 0
    for case in range(40):
        size = float(np.random.default_rng(case).uniform(1.3, 3.7))
        place = np.log(size) / np.log(4) + 0.05 * np.random.default_rng([case, 1]).standard_normal()
        measured = recording((("left", {"size": size}),), 2 * RIG + case)
        [found] = about(believed((LEFT,), place), measured, case)[0].estimates()
        held += found.low <= size <= found.high
    # of forty, fewer than 35 happen in 1 of 100 where each is held with 95 %
    assert held >= 35


def test_where_which_of_several_it_is_is_all_that_is_told_the_search_stands() -> None:
    """As with swapped channels: rigs about it are all alike, and have no more to tell."""
    which = Cause("left", "here", (Parameter("size", "", ((1.0, 4.0),), whole=True),))
    ranked = believed((which,), 0.625, deviation=0.01)  # the third of four
    found, focus = about(ranked, recording((("left", {"size": 3.0}),), RIG))
    assert found is ranked
    assert focus is None


def test_each_rig_about_an_effect_of_a_sensor_has_a_motion_of_its_own() -> None:
    drawn = list[Draw]()

    def observe(draws: Sequence[Draw]) -> list[Observed]:
        drawn.extend(draws)
        return TOY.observe(draws)

    measured, rng = recording((("gain", {"size": 2.0}),), RIG), np.random.default_rng(0)
    refocused(believed((GAIN,), 0.5), measured, MOMENTS, [4.0], RIGS, observe, rng, Library())
    assert len({each.seed for each in drawn}) == len(drawn) >= RIGS
    assert all(len(each.sensing) == 1 for each in drawn)


def test_rigs_are_moved_to_what_is_asked_for() -> None:
    measured = recording((("left", {"size": 3.0}),), RIG)
    _, focus = about(believed((LEFT,), np.log(2.8) / np.log(4)), measured)
    assert focus is not None
    for size in (2.8, 3.0, 3.2):
        rigs = MOMENTS(focus.rigs_at(np.array([size])))[:, : len(TOY.layout.cells)]
        expected = response((("left", {"size": size}),))
        # a rig scatters by 1.1 in each cell, the mean of some thirty by 0.2, and by twice that where slopes
        # lead a deviation or two away
        assert np.sqrt(np.mean((rigs.mean(axis=0) - expected) ** 2)) < 0.4
        assert np.mean(rigs.std(axis=0)) == pytest.approx(np.hypot(0.5, 1.0), rel=0.15)


def test_rigs_stay_on_the_side_of_what_is_believed() -> None:
    signed = Cause("left", "here", (Parameter("size", "m", ((-4.0, -1.0), (1.0, 4.0))),))
    asked: list[float] = []

    def kept(draws: Sequence[Draw]) -> list[Observed]:
        asked.extend(float(values["size"]) for draw in draws for _, values in draw.effects)
        return TOY.observe(draws)

    ranked = believed((signed,), 0.53)
    measured = recording((("left", {"size": 1.2}),), RIG)
    refocused(ranked, measured, MOMENTS, [BLOCKS], RIGS, kept, np.random.default_rng(0), Library())
    assert len(asked) >= RIGS
    assert min(asked) >= 1.0


def test_nothing_has_no_parameters() -> None:
    nothing = Ranked((), 1.0, Posterior(np.zeros((1, 0)), np.ones(1), 0.0), 0.5)
    assert about(nothing, recording((), RIG)) == (nothing, None)


def test_without_time_what_the_search_found_stays() -> None:
    ranked = believed((LEFT,), 0.5)
    measured = recording((("left", {"size": 2.0}),), RIG)
    found, focus = refocused(
        ranked,
        measured,
        MOMENTS,
        [BLOCKS],
        RIGS,
        lambda draws: [() for _ in draws],
        np.random.default_rng(0),
        Library(),
    )
    assert found is ranked
    assert focus is None


def test_rigs_that_tell_less_than_is_known_change_nothing() -> None:
    # its own scatter is 0.07, of 3 and over the logarithm of 4: 0.02 of the cube
    ranked = believed((LEFT,), np.log(2.9) / np.log(4), deviation=0.002)
    found, focus = about(ranked, recording((("left", {"size": 3.0}),), RIG))
    assert found is ranked
    assert focus is None


def test_fewer_blocks_say_less() -> None:
    measured = recording((("left", {"size": 3.0}),), RIG)
    _, focus = about(believed((LEFT,), np.log(2.8) / np.log(4)), measured)
    assert focus is not None
    for one, two in ((1.0, 2.0), (2.0, 4.0)):  # both of what was simulated itself: two blocks
        fewer, more = (focus.following.response(np.full(len(MOMENTS.runs), each)) for each in (one, two))
        assert fewer.precision[0, 0] < 0.9 * more.precision[0, 0]


def test_rigs_of_earlier_rounds_count_where_they_lie_among_the_later() -> None:
    asked = list[int]()

    def counted(draws: Sequence[Draw]) -> list[Observed]:
        asked.append(len(draws))
        return TOY.observe(draws)

    measured = recording((("left", {"size": 3.0}),), RIG)
    ranked = believed((LEFT,), np.log(2.8) / np.log(4))
    library = Library()
    _, focus = refocused(
        ranked, measured, MOMENTS, [BLOCKS], RIGS, counted, np.random.default_rng(0), library
    )
    assert focus is not None
    assert library.count((LEFT,)) == sum(asked)
    assert asked[-1] < len(focus.places) < sum(asked)
    # and lie as the last ones do, whatever round they are of
    assert np.ptp(focus.places) < 0.5
