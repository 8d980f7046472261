"""Several seeds are one answer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from sim_twin.diagnosis.diagnose import Effort, diagnose
from sim_twin.diagnosis.findings import Findings
from sim_twin.diagnosis.pooled import pooled
from tests.sim_twin.diagnosis.toy import CAUSES, Toy, recording


@cache
def found() -> Findings:
    measured = recording((("left", {"size": 2.0}),), 10**6)
    return diagnose(Toy(), measured, Effort(220, 24), Toy().observe, 0)


def test_several_seeds_are_one_answer_which_most_of_them_give() -> None:
    sure = found()
    assert pooled([sure]) is sure
    faint = replace(sure, none=0.6, effect=0.3, unknown=0.1, selected=(), effects=())
    both = pooled([faint, sure, sure])
    assert (both.verdict, both.names) == ("effect", ("left",))
    assert both.none == pytest.approx((0.6 + 2 * sure.none) / 3)
    assert both.none + both.effect + both.unknown == pytest.approx(1.0)
    assert {each.cause.name for each in both.judged} == {cause.name for cause in CAUSES}
    assert both.simulations == 3 * sure.simulations


def test_an_interval_holds_what_other_seeds_found() -> None:
    sure = found()
    first = sure.judged[0]
    shifted = replace(first.parameters["size"], value=9.0)
    other = replace(sure, judged=(replace(first, parameters={"size": shifted}), *sure.judged[1:]))
    whole = pooled([sure, other])
    assert whole.judged[0].present == pytest.approx(first.present)
    both = whole.judged[0].parameters["size"]
    assert (both.value, both.low, both.high) == (
        first.parameters["size"].value, first.parameters["size"].low, 9.0
    )  # fmt: skip
