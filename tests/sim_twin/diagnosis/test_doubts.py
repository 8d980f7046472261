"""Values that may have been entered wrongly: looked at where no effect explains the runs, never one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from sim_twin.diagnosis.diagnose import Effort, diagnose
from sim_twin.diagnosis.findings import Findings
from sim_twin.diagnosis.library import Library
from sim_twin.diagnosis.search import Search
from sim_twin.diagnosis.subject import Draw, Named, Observed
from tests.sim_twin.diagnosis.toy import CAUSES, LEFT, LENGTH, Toy, recording, spent
from tests.tiers import first_short

EFFORT = Effort(220, 24)
DOUBTING = Toy(doubts=(LENGTH,))
RIG = 4 * 10**6


def found(sizes: Sequence[tuple[str, float]], seed: int, subject: Toy = DOUBTING) -> Findings:
    effects: list[Named] = [(name, {"size": size}) for name, size in sizes]
    return diagnose(subject, recording(effects, RIG + seed), EFFORT, subject.observe, seed)


@pytest.mark.parametrize("seed", first_short(range(2)))
def test_a_wrong_value_is_unknown_to_the_catalogue_and_told_with_its_size(seed: int) -> None:
    findings = found(((LENGTH.name, 3.0),), seed)
    assert findings.verdict == "unknown"
    assert findings.selected == ()
    assert findings.effects == ()
    [length] = findings.entered
    assert length.cause == LENGTH
    assert length.probability > 0.8
    assert length.estimate.low < 3.0 < length.estimate.high
    assert length.estimate.value == pytest.approx(3.0, abs=0.4)
    assert max(findings.by_location, key=lambda each: findings.by_location[each]) == "model"
    # it explains all that is there
    assert findings.left.unknown < 0.2
    assert found(((LENGTH.name, 3.0),), seed, Toy()).left.unknown > 0.9


@pytest.mark.parametrize("seed", range(2))
def test_an_effect_is_found_beside_a_wrong_value(seed: int) -> None:
    findings = found((("left", 2.5), (LENGTH.name, 3.0)), seed)
    assert findings.verdict == "effect"
    assert findings.selected == (LEFT, LENGTH)
    assert findings.names == ("left",)
    [(name, values)] = findings.effects
    assert name == "left"
    assert values["size"] == pytest.approx(2.5, abs=0.8)
    assert {each.cause.name for each in findings.judged} == {each.name for each in CAUSES}
    assert findings.judged[0].probability > 0.8
    assert findings.entered[0].probability > 0.8
    assert findings.gap.after == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("sizes", [(), (("left", 2.0),)])
def test_nobody_doubts_where_the_runs_are_explained(sizes: Sequence[tuple[str, float]]) -> None:
    drawn = list[Draw]()

    def observe(draws: Sequence[Draw]) -> list[Observed]:
        drawn.extend(draws)
        return DOUBTING.observe(draws)

    measured = recording([(name, {"size": size}) for name, size in sizes], RIG)
    findings = diagnose(DOUBTING, measured, EFFORT, observe, 0)
    assert findings.entered == ()
    assert not any(name == LENGTH.name for draw in drawn for name, _ in draw.effects)


@pytest.mark.parametrize("seed", range(3))
def test_a_value_that_is_a_little_wrong_beside_an_effect_leaves_a_whole_answer(seed: int) -> None:
    findings = found((("left", 2.5), (LENGTH.name, 0.3)), seed)
    assert findings.none + findings.effect + findings.unknown == pytest.approx(1.0)
    assert sum(findings.by_location.values()) == pytest.approx(1.0)
    assert findings.judged[0].cause == LEFT


def test_one_that_is_looked_at_beside_what_was_found_is_known_by_itself() -> None:
    subject = Toy(doubts=(LENGTH,))
    rng = np.random.default_rng(0)
    measured = recording([("left", {"size": 2.5})], RIG)
    search = Search(subject, measured, subject.observe, rng, Library(), EFFORT.search, doubting=False)
    spent(search)
    assert not search.doubt()
    search.doubting = True
    assert search.doubt()
    assert (LENGTH,) in search.learn().emulators
    assert not search.doubting
