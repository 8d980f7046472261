"""Thresholds for "unknown" that never saw the class, or the half, that they are judged on."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.blind import metrics
from benchmarks.blind.cases import Case
from benchmarks.blind.catalogue import EffectEntry
from benchmarks.blind.held_out import class_of, folds, threshold, with_classes_held_out
from tests.benchmarks_blind.stories import answer, case


def _outsider(name: str, p: float) -> Case:
    effect: EffectEntry = {"name": name, "parameters": {}}
    return case("strong", answer({"unknown": p, "none": 1 - p}), effect)


def _inside(p: float) -> Case:
    return case("none", answer({"unknown": p, "none": 1 - p}))


INSIDE = [_inside(p) for p in (0.02, 0.03, 0.05, 0.06, 0.08, 0.10)]
LOUD = [_outsider(name, p) for name in ("hum", "clip", "drop") for p in (0.8, 0.9)]


def test_no_fold_judges_what_it_was_set_by() -> None:
    every = list(folds([*INSIDE, *LOUD]))
    assert len(every) == 3 * 2
    for fold in every:
        outside, inside = fold.judged
        assert len({class_of(each) for each in outside}) == 1
        assert not {class_of(each) for each in outside} & {class_of(each) for each in fold.set_by[0]}
        assert not {id(each) for each in inside} & {id(each) for each in fold.set_by[1]}
        assert len(inside) + len(fold.set_by[1]) == len(INSIDE)


def test_a_threshold_lies_between_what_it_parts() -> None:
    assert threshold(np.array([0.8, 0.9]), np.array([0.1, 0.2])) == pytest.approx(0.5)
    # one outsider among the others is given up
    assert threshold(np.array([0.1, 0.8, 0.9]), np.array([0.2, 0.3, 0.4])) == pytest.approx(0.6)


def test_a_class_like_the_others_is_found_and_a_quiet_one_is_not() -> None:
    quiet = [_outsider("play", 0.04), _outsider("play", 0.07)]
    judged = with_classes_held_out([*INSIDE, *LOUD, *quiet])
    outside = [each for each in judged if each.outside]
    loud, silent = (
        [each for each in outside if (class_of(each) == "play") is which] for which in (False, True)
    )
    assert {each.above for each in loud} == {1.0} == {each.outranks for each in loud}
    assert {metrics.above(each) for each in silent} == {0.0}
    # 0.04 lies above two of the six others, 0.07 above four, by halves
    assert [metrics.outranks(each) for each in silent] == pytest.approx([2 / 6, 4 / 6])
    inside = [each for each in judged if not each.outside]
    assert {each.outranks for each in inside} == {None}
    # thresholds that the quiet class helps to set lie among these, by one half of them
    assert np.mean([each.above or 0.0 for each in inside]) < 0.3


def test_where_one_class_is_all_there_is_nothing_is_held_out() -> None:
    alone = with_classes_held_out([*INSIDE, *LOUD[:2]])
    assert {each.above for each in alone} == {None}
