"""What a budget buys, by the rig and its runs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rig.diagnosis.recordings import setting_of
from rig.files.scenario import parse_scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.diagnose import effort_for
from tests.rig.diagnosis.measured_log import BEAM, RATE


@pytest.fixture(scope="module")
def run() -> RunSetting:
    twin = twin_of(parse_scenario(BEAM))
    return setting_of(twin, twin.channels, RATE, 4)


def test_a_budget_buys_fewer_motions_of_more_runs_but_as_close_a_first_look(run: RunSetting) -> None:
    long = replace(run, cycles=120 * run.cycles)
    once, thrice = (effort_for(Campaign((long,) * runs), 120.0) for runs in (1, 3))
    assert once.of_longest == once.search
    assert 2 * thrice.search < once.search
    assert thrice.of_longest == once.of_longest
    assert effort_for(Campaign((long, run)), 120.0).of_longest == once.of_longest


def test_of_short_runs_no_more_is_simulated_than_tells_something(run: RunSetting) -> None:
    once, thrice = (effort_for(Campaign((run,) * runs), 120.0) for runs in (1, 3))
    assert once == thrice
    assert effort_for(Campaign((run,)), 240.0).motions == 2 * once.motions
