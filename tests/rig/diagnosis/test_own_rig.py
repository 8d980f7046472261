"""A diagnosis of somebody's own rig for which time runs out says what it left out."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest

from daq.errors import SimulationFailed
from rig.diagnosis.own_rig import _in_time, _lacking
from tests.rig.diagnosis.test_workers import LATER

WHOLE: Any = SimpleNamespace(searched=1.0, judging=1.0)
CUT: Any = SimpleNamespace(searched=0.62, judging=0.0)


def ask(number: int) -> Any:
    if number > 1:
        raise SimulationFailed("not enough was simulated", "give it more time", None)
    return WHOLE


def test_after_the_end_of_the_time_what_was_found_before_it_stands() -> None:
    assert _in_time((1, 2, 3), ask, time.monotonic() - 1.0) == {1: WHOLE}


def test_a_simulation_that_fails_earlier_is_a_fault() -> None:
    with pytest.raises(SimulationFailed, match="not enough was simulated"):
        _in_time((1, 2), ask, time.monotonic() + LATER)


@pytest.mark.parametrize(
    ("by_seed", "by_width", "words"),
    [
        ({0: WHOLE, 1: WHOLE}, {2.0: WHOLE}, []),
        ({0: WHOLE}, {2.0: WHOLE}, ["there was time for 1 of 2 seeds"]),
        ({0: WHOLE, 1: CUT}, {}, ["62 % of the search was done", "with healthy rigs 2 times as wide"]),
        ({0: WHOLE, 1: WHOLE}, {2.0: CUT}, ["no time was left for all of it with healthy rigs 2 times"]),
    ],
    ids=["all", "a seed", "a part", "a width"],
)
def test_what_lacks_is_told(by_seed: dict[int, Any], by_width: dict[float, Any], words: list[str]) -> None:
    told = _lacking(by_seed, by_width, 2, [2.0])
    assert len(told) == len(words)
    assert all(each in one for each, one in zip(words, told, strict=True)), told
