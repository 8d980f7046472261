"""What one can argue with: contrasts with the runner-up, what each run says alone, an answer cut short."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from sim_twin.diagnosis.diagnose import Effort, diagnose
from sim_twin.diagnosis.findings import Findings
from sim_twin.diagnosis.fingerprint import SLICES, Layout
from sim_twin.diagnosis.subject import Draw, Observed
from tests.sim_twin.diagnosis.toy import CELLS, LEFT, RIGHT, Blocks, Toy, recording

EFFORT = Effort(220, 24)
RIG = 10**6
HALF = CELLS // 2


@dataclass(frozen=True, slots=True)
class TwoRuns(Toy):
    """The first half of the cells are of one run, the others of another."""

    @property
    def layout(self) -> Layout:
        cells = Toy().layout.cells
        return Layout(tuple(replace(cell, run=k // HALF) for k, cell in enumerate(cells)))


def stopped(after: int) -> Callable[[Sequence[Draw]], list[Observed]]:
    """Simulates so many draws; then there is no more time."""
    left = after

    def execute(draws: Sequence[Draw]) -> list[Observed]:
        nonlocal left
        done = min(left, len(draws))
        left -= done
        return [*Toy().observe(draws[:done]), *(() for _ in draws[done:])]

    return execute


def of_runs(first: float, second: float, rig: int = RIG) -> Blocks:
    """Of a rig whose left differs from one run to the other."""
    one, other = (recording((("left", {"size": size}),), rig) for size in (first, second))
    return np.concatenate([one[:, : HALF * SLICES], other[:, HALF * SLICES :]], axis=1)


@cache
def found(
    first: float, second: float, motions: int = 10**6, told: tuple[float, ...] = (), rig: int = RIG
) -> Findings:
    return diagnose(TwoRuns(), of_runs(first, second, rig), EFFORT, stopped(motions), 0, told)


def test_each_run_says_by_itself_what_it_is_and_how_large() -> None:
    first, second = found(2.0, 2.0).alone
    assert (first.run, second.run) == (0, 1)
    for each in (first, second):
        assert each.shares[0][0] == (LEFT,)
        assert sum(share for _, share in each.shares) == pytest.approx(1.0)
        [[size]] = each.estimates
        assert size.value == pytest.approx(2.0, abs=0.6)
        assert size.low < size.value < size.high
    # one rig's: what belongs to it is another in other cells
    (one,), (other,) = first.estimates[0], second.estimates[0]
    assert max(one.low, other.low) < min(one.high, other.high)


def test_a_run_of_few_blocks_says_less() -> None:
    alike, short = found(2.0, 2.0).alone, found(2.0, 2.0, told=(4.0, 1.0)).alone
    widths = [each[1].estimates[0][0].high - each[1].estimates[0][0].low for each in (alike, short)]
    # of a healthy rig's variance of a quarter, and of a block's of 1: a half over four, 1.25 of one
    assert widths[1] > 1.25 * widths[0]


def test_runs_that_contradict_each_other_say_so() -> None:
    findings = found(1.2, 3.4)
    assert findings.selected == ()  # no one size fits both
    assert [each.best for each in findings.alone] == [(LEFT,), (LEFT,)]
    (one,), (other,) = (each.estimates[0] for each in findings.alone)
    assert one.value == pytest.approx(1.2, abs=0.5)
    assert other.value == pytest.approx(3.4, abs=0.6)
    assert one.high < other.low


def test_a_single_run_has_nothing_to_agree_with() -> None:
    findings = diagnose(Toy(), recording((("right", {"size": 3.0}),), RIG), EFFORT, Toy().observe, 0)
    assert findings.selected == (RIGHT,)
    assert findings.alone == ()
    assert [len(course) for course in (*findings.gap.course_before, *findings.gap.course_after)] == [4, 4]


def test_the_runner_up_is_told_by_figures_in_which_it_predicts_otherwise() -> None:
    findings = found(2.0, 2.0)
    assert findings.runner_up is not None
    told, cells = findings.contrasts, findings.layout.cells
    assert len({(cells[each.cell].channel, cells[each.cell].what) for each in told}) == len(told) == 4
    assert [each.apart for each in told] == sorted((each.apart for each in told), reverse=True)
    assert told[0].apart > 1
    # what was measured lies where the right one says
    assert all(abs(each.measured - each.chosen) < abs(each.measured - each.rival) for each in told[:3])
    for each in told:
        at = slice(each.cell * SLICES, (each.cell + 1) * SLICES)
        assert each.rival == pytest.approx(findings.runner_up[1][at].mean())


def test_an_answer_that_was_cut_short_is_wider_and_says_so() -> None:
    wider = []
    for rig in range(RIG, RIG + 5):
        # too small to lead at the first look
        whole, part = (found(1.2, 1.2, motions, rig=rig) for motions in (10**6, 100))
        assert whole.searched == whole.judging == 1.0
        assert part.judging == 0.0
        assert part.searched == pytest.approx(0.45, abs=0.02)
        assert part.effect < whole.effect
        sizes = [
            next(each for each in one.judged if each.cause == LEFT).parameters["size"]
            for one in (whole, part)
        ]
        wider.append((sizes[1].high - sizes[1].low) / (sizes[0].high - sizes[0].low))
    assert np.median(wider) > 1.2


@pytest.mark.parametrize("size", [0.0, 2.0])
def test_where_time_ran_out_after_the_search_the_judging_says_so(size: float) -> None:
    asked: list[int] = []

    def counted(draws: Sequence[Draw]) -> Sequence[Observed]:
        asked.append(len(draws))
        return Toy().observe(draws)

    measured = recording((("left", {"size": size}),) if size else (), RIG)
    whole = diagnose(Toy(), measured, EFFORT, counted, 0)
    assert (whole.searched, whole.judging) == (1.0, 1.0)
    # the last that is asked for are rigs with each of the candidates in
    part = diagnose(Toy(), measured, EFFORT, stopped(sum(asked) - asked[-1]), 0)
    assert part.searched == 1.0
    assert 0.4 < part.judging < 0.8
    assert part.verdict == whole.verdict
