"""What a further run is to tell apart, and how well it would."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from sim_twin.diagnosis.diagnose import Effort, diagnose
from sim_twin.diagnosis.findings import Findings
from sim_twin.diagnosis.separability import rivals_of, told_apart
from sim_twin.diagnosis.subject import Draw, Observed
from tests.sim_twin.diagnosis.toy import Toy, recording

TOY = Toy()


@cache
def findings() -> Findings:
    """Of a rig with one of the two effects that look alike."""
    return diagnose(TOY, recording((("aspect", {"size": 3.0}),), 10**6), Effort(220, 24), TOY.observe, 0)


def believed(found: Findings, **probabilities: float) -> Findings:
    judged = (replace(one, probability=probabilities.get(one.cause.name, 0.0)) for one in found.judged)
    return replace(found, judged=tuple(judged))


def rival_names(found: Findings) -> set[str]:
    rivals = rivals_of(found)
    return set() if rivals is None else {each.cause.name for each in rivals}


def test_two_effects_that_may_both_be_the_cause_are_rivals() -> None:
    assert rival_names(findings()) == {"aspect", "likeness"}


def test_the_rival_of_a_sure_effect_is_what_is_told_from_it_least() -> None:
    told = {("left", "right"): 0.99, ("left", "gain"): 0.9, ("right", "left"): 0.8, ("gain", "left"): 0.97}
    sure = replace(believed(findings(), left=0.98), separability=told)
    assert rival_names(sure) == {"left", "right"}


def test_where_nothing_is_missing_there_is_nothing_to_tell_apart() -> None:
    assert rivals_of(replace(findings(), none=0.9, effect=0.05, unknown=0.05)) is None


def test_responses_far_apart_are_told_apart_and_the_same_one_is_a_guess() -> None:
    def share(one: str, other: str) -> float | None:
        rivals = ([(one, {"size": 3.0})], [(other, {"size": 3.0})])
        return told_apart(TOY, rivals, TOY.observe, np.random.default_rng(1))

    far, same = share("left", "right"), share("aspect", "likeness")
    assert far is not None
    assert far > 0.9
    assert same is not None
    # of 20 rigs sorted by chance, 95 in 100 times no more than 14 come out right: (14 + 1) / 22
    assert same <= 0.69


def test_without_rigs_nothing_is_promised() -> None:
    def too_late(draws: Sequence[Draw]) -> list[Observed]:
        return [() for _ in draws]

    rivals = ([("left", {"size": 3.0})], [("right", {"size": 3.0})])
    assert told_apart(TOY, rivals, too_late, np.random.default_rng(1)) is None
