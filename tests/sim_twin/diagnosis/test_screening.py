"""Causes are looked at run by run, and what a run rules out is not simulated for the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from sim_twin.diagnosis import search
from sim_twin.diagnosis.fingerprint import SLICES
from sim_twin.diagnosis.library import Library, order_of
from sim_twin.diagnosis.screening import Screening, layout_of, numbers_of
from sim_twin.diagnosis.search import Ranked, Search
from sim_twin.diagnosis.subject import Draw, Named, Observed
from sim_twin.effects import Parameter
from tests.sim_twin.diagnosis.test_arguments import HALF, RIG, TwoRuns
from tests.sim_twin.diagnosis.toy import CAUSES, GAIN, LEFT, RIGHT, recording, spent

MOTIONS = 260


@dataclass(frozen=True, slots=True)
class Runs(TwoRuns):
    """Observes those runs that a draw asks for."""

    def only(self, numbers: tuple[int, ...]) -> Runs:
        return self

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        numbers = [numbers_of(self.layout, draw.runs or (0, 1)) for draw in draws]
        shown = super(Runs, self).observe(draws)
        return [
            tuple(None if one is None else one[:, at] for one in each)
            for each, at in zip(shown, numbers, strict=True)
        ]


SUBJECT = Runs()
SMALL = Parameter("size", "m", ((0.02, 4.0),))


def searched(
    effects: Sequence[Named], subject: Runs = SUBJECT, seed: int = 0
) -> tuple[list[Ranked], Counter[tuple[int, ...]]]:
    """What was found, and how many draws of how many runs it took."""
    asked: Counter[tuple[int, ...]] = Counter()

    def counted(draws: Sequence[Draw]) -> list[Observed]:
        asked.update(draw.runs for draw in draws)
        return subject.observe(draws)

    rng = np.random.default_rng(seed)
    looking = Search(subject, recording(effects, RIG + seed), counted, rng, Library(), MOTIONS)
    return spent(looking)[1], asked


def one(name: str, size: float) -> tuple[Named, ...]:
    return ((name, {"size": size}),)


@pytest.fixture(autouse=True)
def best_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of five causes, four rivals would be all."""
    monkeypatch.setattr(search, "_LEFT_IN", 1)


def test_what_one_run_rules_out_is_not_simulated_for_the_others_and_is_judged_by_that_one() -> None:
    ranked, asked = searched(one("left", 3.0))
    assert ranked[0].hypothesis == (LEFT,)
    assert ranked[0].probability > 0.9
    single = Counter({runs: count for runs, count in asked.items() if runs})
    (_, first), (_, then) = single.most_common()
    assert then < 0.5 * first
    assert {each.hypothesis for each in ranked if len(each.hypothesis) == 1} == {(each,) for each in CAUSES}
    gone = next(each for each in ranked if each.hypothesis == (RIGHT,))
    assert 0 < gone.probability < 1e-3


def test_of_a_healthy_rig_one_run_rules_out_little() -> None:
    hiding = Runs(tuple(replace(cause, parameters=(SMALL,)) for cause in CAUSES))
    ranked, asked = searched((), hiding)
    assert ranked[0].hypothesis == ()
    # each cause may hide in what the other run shows
    assert asked[(0,)] > 0.7 * asked[(1,)] > 0.49 * asked[(0,)]


def test_what_was_ruled_out_by_itself_is_found_beside_another() -> None:
    ranked, _ = searched((("left", {"size": 3.0}), ("right", {"size": 3.5})))
    assert set(ranked[0].hypothesis) == {LEFT, RIGHT}


def test_cases_are_observed_once_of_each_run_and_only_what_was_seen_of_all_is_a_case() -> None:
    order = order_of(
        {(LEFT,): np.array([[2.0], [3.0]]), (GAIN,): np.full((8, 1), 2.0)}, np.random.default_rng(1)
    )
    asked: list[Draw] = []

    def kept(draws: Sequence[Draw]) -> list[Observed]:
        asked.extend(draws)
        return SUBJECT.observe(draws)

    screening = Screening(order, kept)
    screening.observe(1, [(LEFT,), (GAIN,)])
    screening.observe(1, [(LEFT,)])
    screening.observe(0, [(GAIN,)])
    assert [draw.runs for draw in asked].count((1,)) == len(order)
    assert all(not draw.effects for draw in asked if draw.runs == (0,))
    whole = Library()
    screening.add_to(whole, [0, 1], [(LEFT,), (GAIN,)])
    assert (whole.count((LEFT,)), whole.count((GAIN,))) == (0, 8)
    part = Library()
    screening.add_to(part, [1], [(LEFT,)])
    assert (part.count((LEFT,)), part.count((GAIN,))) == (2, 0)
    (same,) = SUBJECT.observe([order.draws[0]])
    assert same[0] is not None
    assert np.array_equal(part.fingerprints((LEFT,))[0], same[0][:, HALF * SLICES :])
    # the numbers of both runs side by side are those of a draw of all
    shared = next(draw for draw in order.draws if not draw.effects)
    (together,) = SUBJECT.observe([shared])
    assert together[0] is not None
    assert np.array_equal(whole.fingerprints((GAIN,))[0], together[0])


def test_the_cells_of_some_runs_are_numbered_anew() -> None:
    part = layout_of(SUBJECT.layout, [1])
    assert {cell.run for cell in part.cells} == {0}
    assert part.size == len(numbers_of(SUBJECT.layout, [1])) == HALF * SLICES
