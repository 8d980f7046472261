"""How far the gap shrinks is judged on blocks that nothing was fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.belief import Belief, Unexplained, belief_of, of_a_part
from sim_twin.diagnosis.diagnose import candidates_of
from sim_twin.diagnosis.gap import GapMeasure, gap_measure
from sim_twin.diagnosis.judging import (
    gap_between,
    halves,
    leads_away,
    moved_by,
    refitted,
    repaired_twins,
    without_idle_partners,
)
from sim_twin.diagnosis.library import Library
from sim_twin.diagnosis.search import Ranked, Search
from sim_twin.diagnosis.subject import Draw, Named, Observed
from tests.sim_twin.diagnosis.toy import BLOCKS, DIRECTIONS, GAIN, LEFT, RIGHT, Toy, recording, spent

TOY = Toy()
RIG = 10**6
LEFT_2 = (("left", {"size": 2.0}),)


@cache
def searched() -> tuple[Attribution, list[Ranked], Library]:
    library = Library()
    search = Search(TOY, recording(LEFT_2, RIG), TOY.observe, np.random.default_rng(0), library, 220)
    return (*spent(search), library)


@cache
def measure() -> GapMeasure:
    return gap_measure([recording((), seed, 2) for seed in range(60)], TOY.layout)


def twins(size: float, count: int = 24) -> NDArray[np.float64]:
    shown = [recording((("left", {"size": size}),), 500 + k, 1) for k in range(count)]
    return np.concatenate(shown).astype(np.float64)


def both(left: float, right: float) -> tuple[Named, ...]:
    return (("left", {"size": left}), ("right", {"size": right}))


def twins_of(effects: Sequence[Named]) -> NDArray[np.float64]:
    return np.concatenate([recording(effects, 900 + k, 1) for k in range(24)]).astype(np.float64)


@pytest.mark.parametrize(("blocks", "fitted"), [(2, 1), (3, 2), (6, 3)])
def test_half_of_the_blocks_are_held_out(blocks: int, fitted: int) -> None:
    measured = recording((), 1, blocks)
    to, on = halves(measured)
    assert (len(to), len(on)) == (fitted, blocks - fitted)
    assert np.array_equal(to, measured[::2])
    assert np.array_equal(on, measured[1::2])


def test_one_block_is_both() -> None:
    measured = recording((), 1, 1)
    assert all(part is measured for part in halves(measured))


def test_repaired_twins_are_new_rigs_at_what_fits_the_given_blocks() -> None:
    attribution, ranked, library = searched()
    asked: list[Draw] = []

    def kept(draws: Sequence[Draw]) -> list[Observed]:
        asked.extend(draws)
        return TOY.observe(draws)

    # those of sensors share motions
    candidates = [each for each in ranked if any(not cause.sensing for cause in each.hypothesis)][:2]
    assert candidates[0].hypothesis == (LEFT,)
    other = recording((("left", {"size": 3.0}),), RIG + 1)
    rng = np.random.default_rng(1)
    repaired = repaired_twins(refitted(candidates, attribution, other, rng), 40, kept, rng)
    assert {h: twins.shape for h, twins in repaired.items()} == {
        each.hypothesis: (20, TOY.layout.size) for each in candidates
    }
    assert len({draw.seed for draw in asked}) == 40
    alone = [draw.effects[0] for draw in asked if len(draw.effects) == 1 and draw.sensing == ((),)]
    sizes = {float(values["size"]) for name, values in alone if name == "left"}
    # fitted to the blocks that it was given, of size 3, not to those of the search, of size 2
    assert len(sizes) == 1
    assert sizes.pop() == pytest.approx(3.0, abs=0.4)
    assert library.count((LEFT,)) == len(library.values((LEFT,)))


def test_what_could_not_be_simulated_is_not_judged() -> None:
    attribution, ranked, _ = searched()
    rng, candidates = np.random.default_rng(1), [each for each in ranked if each.hypothesis][:2]
    fits = refitted(candidates, attribution, recording(LEFT_2, RIG), rng)
    repaired = repaired_twins(fits, 20, lambda draws: [(None,) for _ in draws], rng)
    assert repaired == {}


def test_the_right_repair_closes_the_gap_and_the_interval_holds_that() -> None:
    measured = recording(LEFT_2, RIG, 6)
    gap = gap_between(measure(), measured, measured, twins(2.0), np.random.default_rng(2))
    assert gap.before > 2
    # as a healthy rig: 48 cells of one rig, four dozen of which average to some per cents
    assert gap.after == pytest.approx(1.0, abs=0.2)
    assert gap.shrink == pytest.approx(1 - max(gap.after - 1, 0) / (gap.before - 1))
    assert gap.shrink is not None
    assert gap.shrink_ci95 is not None
    assert gap.shrink_ci95[0] <= gap.shrink <= gap.shrink_ci95[1] <= 1
    assert len(gap.cells_before) == len(gap.cells_after) == len(TOY.layout.cells)


def test_what_is_left_open_of_a_parameter_widens_the_interval_of_the_shrink() -> None:
    _, ranked, library = searched()
    fit = next(each for each in ranked if each.hypothesis == (LEFT,))
    low, high = np.quantile(fit.values()[:, 0], (0.1, 0.9))
    assert low < 1.5 < 2.6 < high  # places far from the posterior are among its places, with no weight
    flat = replace(
        fit,
        posterior=replace(fit.posterior, weights=np.full_like(fit.posterior.weights, 1 / len(fit.values()))),
    )
    moved = {
        name: moved_by(one, None, library, np.random.default_rng(6))
        for name, one in (("sure", fit), ("open", flat))
    }
    # the slope of size and a tenth of its square over the logarithm of size, in which it is searched
    best = fit.best()[0]
    size = (
        np.log(fit.values()[:, 0]).std() * (best + 0.2 * best**2) * np.sqrt(np.mean(DIRECTIONS["left"] ** 2))
    )
    # of eight seeds 1.06 to 1.32 of it: lines through a few rigs of a response that is bent
    assert 0.95 < np.sqrt(np.mean(moved["open"].var(axis=0))) / size < 1.45
    measured = recording(LEFT_2, RIG, 6)
    widths = [
        np.ptp(
            gap_between(
                measure(), measured, measured, twins(2.0), np.random.default_rng(2), moved=each
            ).shrink_ci95
        )
        for each in (None, moved["sure"], moved["open"])
    ]
    assert widths[0] < widths[1] < 0.5 * widths[2]


def test_half_a_repair_shrinks_the_gap_by_less() -> None:
    measured, rng = recording(LEFT_2, RIG, 6), np.random.default_rng(3)
    shrinks = [
        gap_between(measure(), measured, measured, twins(size), rng).shrink for size in (2.0, 1.0, 4.0)
    ]
    right, half, beyond = (float("nan") if each is None else each for each in shrinks)
    assert right > half > 0
    assert beyond < 0  # farther away on the other side


def test_without_a_repair_nothing_shrinks() -> None:
    measured = recording(LEFT_2, RIG)
    gap = gap_between(measure(), measured, measured, None, np.random.default_rng(4))
    assert (gap.after, gap.shrink, gap.shrink_ci95) == (gap.before, 0.0, None)


def test_where_there_is_no_gap_shrink_means_nothing() -> None:
    measured = recording((), RIG + 3)
    on_the_twin = np.tile(measure().twin.astype(np.float32), (4, 1))
    near = gap_between(measure(), on_the_twin, measured, twins(2.0), np.random.default_rng(5))
    assert near.before == pytest.approx(0.0, abs=1e-6)
    assert near.shrink is None
    assert near.shrink_ci95 is None


def test_a_recording_s_own_blocks_lie_apart_as_blocks_of_one_rig() -> None:
    values = [
        gap_between(measure(), each, each, None, np.random.default_rng(0)).recording
        for each in (recording((), RIG + k, BLOCKS) for k in range(20))
    ]
    # four blocks scatter by 1 about their mean, less a quarter of it; a healthy rig's by 1 and its own half
    assert np.mean(values) == pytest.approx(np.sqrt(0.75 / 1.25), abs=0.03)


def test_a_second_effect_that_mends_nothing_is_not_selected() -> None:
    _, ranked, _ = searched()
    single = next(each for each in ranked if each.hypothesis == (LEFT,))
    pair = replace(single, hypothesis=(LEFT, RIGHT))
    repaired = {(LEFT,): twins(2.0), (LEFT, RIGHT): twins_of(both(2.0, 3.0))}
    for measured, expected in ((LEFT_2, single), (both(2.0, 3.0), pair)):
        judged_on = recording(measured, RIG, 2)
        found = without_idle_partners(pair, [pair, single], repaired, measure(), judged_on)
        assert found is expected
    assert without_idle_partners(single, [single], repaired, measure(), recording(LEFT_2, RIG, 2)) is single


def test_a_repair_that_leads_away_is_refuted_and_one_that_closes_the_gap_is_not() -> None:
    far = recording([("left", {"size": 2.5})], 10**6)
    assert not leads_away(measure(), far, twins(2.5))
    assert leads_away(measure(), far, -twins(2.5))
    # a healthy rig has no gap that anything could close
    assert not leads_away(measure(), np.array([measure().twin], dtype=np.float32), twins(2.5))


def test_what_is_refuted_is_mostly_unknown() -> None:
    refuted = Belief(0.05, 0.05, {"left": 0.8, "right": 0.1}, {"left": 0.8, "right": 0.6}).refuted()
    assert refuted.verdict == "unknown"
    assert refuted.none == 0.05
    assert refuted.none + refuted.effect + refuted.unknown == pytest.approx(1.0)
    assert all(refuted.of_effects[name] <= share < 0.1 for name, share in refuted.present.items())


def test_what_mends_nothing_beside_another_is_hardly_there() -> None:
    belief = Belief(0.05, 0.05, {"left": 0.8, "right": 0.1}, {"left": 0.85, "right": 0.6})
    found = belief.without({"right"}, "left")
    assert found.present == pytest.approx({"left": 0.89, "right": 0.06})
    assert found.of_effects == pytest.approx({"left": 0.89, "right": 0.01})
    assert (found.none, found.unknown) == (belief.none, belief.unknown)
    assert belief.without(set(), "left") == belief


def test_the_larger_of_two_may_be_the_idle_one() -> None:
    """What one believes of it is as little then, and not that it is the largest cause."""
    belief = Belief(0.05, 0.05, {"left": 0.8, "right": 0.1}, {"left": 0.85, "right": 0.6})
    found = belief.without({"left"}, "right")
    assert found.of_effects == pytest.approx({"left": 0.08, "right": 0.82})
    assert found.present == pytest.approx({"left": 0.085, "right": 0.82})
    assert found.none + found.effect + found.unknown == pytest.approx(1.0)


def test_the_unknown_grows_with_what_is_left_and_is_never_ruled_out() -> None:
    usual, beyond = Unexplained(0.4, 0.9, 0.85), Unexplained(5.0, 1.9, 2.5)
    assert 0.0 < usual.unknown < 0.05 < 0.9 < beyond.unknown <= 1.0
    # very good figures do not outweigh a bad one
    assert Unexplained(1e-3, 1e-3, 5.0).unknown == pytest.approx(Unexplained(0.1, 0.1, 5.0).unknown)


def test_evidence_of_a_part_of_a_search_counts_by_as_much() -> None:
    _, ranked, _ = searched()
    assert of_a_part(ranked, 1.0) == ranked
    part = of_a_part(ranked, 0.5)
    assert sum(each.probability for each in part) == pytest.approx(1.0)
    for one, other in zip(ranked[1:4], part[1:4], strict=True):
        before, after = (r.probability / of[0].probability for r, of in ((one, ranked), (other, part)))
        assert after == pytest.approx(np.sqrt(before))
    (whole,), (wider,) = ranked[0].estimates(), part[0].estimates()
    assert wider.high - wider.low > 1.2 * (whole.high - whole.low)
    # nor is what nobody knows of ruled out by as much
    attribution = searched()[0]
    odds = [
        belief.unknown / (1 - belief.unknown)
        for belief in (
            belief_of(attribution, ranked, Unexplained(0.4, 0.9, 0.85), done) for done in (1.0, 0.5)
        )
    ]
    assert odds[1] == pytest.approx(np.sqrt(odds[0]))


def test_each_of_what_was_found_is_held_against_all_but_it() -> None:
    attribution, ranked, library = searched()
    search = Search(TOY, recording(LEFT_2, RIG), TOY.observe, np.random.default_rng(0), library, 220)
    three = replace(ranked[0], hypothesis=(GAIN, LEFT, RIGHT))
    held = candidates_of([three, *ranked], search, attribution)
    assert held[0] is three
    assert {(GAIN, LEFT), (GAIN, RIGHT), (LEFT, RIGHT)} <= {each.hypothesis for each in held}
    # with parameters that fit
    pair = next(each for each in held if each.hypothesis == (GAIN, LEFT))
    assert pair.best().shape == (2,)
    # (a rig without the third mends as much: it is left out)
    repaired = {(GAIN, LEFT, RIGHT): twins(2.0), (GAIN, LEFT): twins(2.0)}
    found = without_idle_partners(three, held, repaired, measure(), recording(LEFT_2, RIG, 2))
    assert found.hypothesis == (GAIN, LEFT)
