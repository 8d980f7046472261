"""A few of the runs that `scripts/soak` kills three hundred times."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from benchmarks.kills import MOST_LOST_S, RIGS, Lost, lost_by, summary, worst_lost

KILLS = 10


def most_lost_s(found: Sequence[Lost]) -> float:
    """But for what came late, as on a busy machine: what a run had not got yet is no loss of the log's."""
    return max(each.seconds - each.late for each in found if each.seconds is not None)


def test_a_killed_run_lost_half_a_second_at_most() -> None:
    """One as it records, one as it closes its log."""
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(partial(lost_by, seed=20), (0, 9)))
    assert all(each.seconds is not None for each in found)
    assert most_lost_s(found) <= MOST_LOST_S, found


@pytest.mark.long
@pytest.mark.timeout(400)
def test_a_killed_run_of_any_rig_is_recovered_and_lost_half_a_second_at_most() -> None:
    """What was sent is held against what is recovered, also of an encoder and of one reading a second."""
    found = list(worst_lost(KILLS, seed=13))
    assert {each.rig for each in found} == set(RIGS)
    assert most_lost_s(found) <= MOST_LOST_S, found


def test_what_had_not_begun_to_record_is_no_kill_that_lost_nothing() -> None:
    told = summary([0.1, 0.2, 0.4], kills=5, before=1)
    assert told.startswith("all 5 recovered; 1 more had ended before, and were tried again\n")
    assert "\n3 had begun to record, and lost at most 0.400 s, median 0.200 s" in told
    assert told.endswith("below 1 of these (95 %)")
    assert summary([], kills=1, before=0).endswith("\n0 had begun to record")
