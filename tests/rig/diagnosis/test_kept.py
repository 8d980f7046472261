"""What was simulated before is not simulated again, and nothing else takes its place."""

from __future__ import annotations

import fcntl
import resource
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.diagnosis import kept
from rig.diagnosis.kept import kept_runs
from rig.diagnosis.recordings import setting_of
from rig.ensembles import Simulated
from rig.files.scenario import parse_scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.subject import Draw, Named, Observed
from tests.rig.diagnosis.measured_log import BEAM, RATE
from tests.rig.diagnosis.test_workers import LATER, Here

LOUD: tuple[Named, ...] = (("sensor_gain", {"channel": "yoke.force", "gain": 1.4}),)
DRAWS = [Draw((), 3), Draw((), 4, ((), LOUD))]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv(kept.KEEP)
    return tmp_path / "rattle" / "simulated"


@cache
def setting(force: str) -> RunSetting:
    twin = twin_of(parse_scenario(BEAM.replace('"9 N"', f'"{force}"')))
    return setting_of(twin, twin.channels, RATE, 2)


def looked(campaign: Campaign, draws: Sequence[Draw] = DRAWS, model: str = "") -> tuple[Any, int, list[str]]:
    """What was seen, how many runs were simulated for it, and what was said."""
    told: list[str] = []
    simulated_runs = 0

    class Counted(Simulated):
        def of(self, subject: Any, draws: Sequence[Draw]) -> list[Observed]:
            nonlocal simulated_runs
            simulated_runs += len(draws) * len(subject.runs)
            return super().of(subject, draws)

    simulated = Counted(campaign, Here(), time.monotonic() + LATER, lambda _: None)
    return kept_runs(campaign, model, told.append).by(simulated)(draws), simulated_runs, told


def same(one: Sequence[Observed], other: Sequence[Observed]) -> bool:
    return all(
        np.array_equal(a, b)  # type: ignore[arg-type]
        for first, second in zip(one, other, strict=True)
        for a, b in zip(first, second, strict=True)
    )


def test_a_second_look_simulates_nothing_and_one_more_run_only_that(monkeypatch: pytest.MonkeyPatch) -> None:
    one = Campaign((setting("9 N"),))
    two = Campaign((setting("9 N"), setting("7 N")))
    first, count, told = looked(one)
    assert (count, told) == (2, [])
    again, count, told = looked(one)
    assert (count, told) == (0, [])
    assert same(first, again)
    more, count, told = looked(two)
    assert (count, told) == (2, [])
    assert same(more, two.observe(DRAWS))
    monkeypatch.setenv(kept.KEEP, "0")
    assert looked(one)[1] == 2
    monkeypatch.delenv(kept.KEEP)
    # another draw, another calibration: nothing known
    assert looked(one, [Draw((), 5)])[1] == 1
    assert looked(one, model="mass = 2")[1] == 2


def test_of_a_draw_that_asks_for_some_runs_the_others_are_simulated_when_they_are_asked_for() -> None:
    two = Campaign((setting("9 N"), setting("7 N")))
    some = [replace(draw, runs=(1,)) for draw in DRAWS]
    shown, count, _ = looked(two, some)
    assert count == 2
    assert same(shown, two.observe(some))
    shown, count, _ = looked(two, [some[0], DRAWS[1]])
    assert count == 1
    assert same(shown, two.observe([some[0], DRAWS[1]]))


def test_what_is_lacking_is_what_not_all_runs_have() -> None:
    two = Campaign((setting("9 N"), setting("7 N")))
    assert kept_runs(two, "", lambda _: None).lacking(DRAWS) == [*DRAWS]
    looked(two, [replace(DRAWS[0], runs=(1,)), DRAWS[1]])
    assert kept_runs(two, "", lambda _: None).lacking(DRAWS) == [DRAWS[0]]


def test_of_a_draw_that_asks_for_some_runs_their_share_is_done() -> None:
    two = Campaign((setting("9 N"), setting("7 N")))
    done: list[float] = []
    simulated = Simulated(two, Here(), time.monotonic() + LATER, done.append)
    observe = kept_runs(two, "", lambda _: None).by(simulated)
    some = [replace(DRAWS[0], runs=(1,)), DRAWS[1]]
    for count in (1.5, 3.0):  # what is known is done as well
        observe(some)
        assert done[-1] == pytest.approx(count)


def test_a_cache_that_is_damaged_or_another_version_s_is_told_and_not_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = Campaign((setting("9 N"),))
    first, _, _ = looked(campaign)
    (file,) = folder.iterdir()
    content = bytearray(file.read_bytes())
    content[-100] ^= 1
    file.write_bytes(content)
    again, count, told = looked(campaign)
    assert count == 1
    assert len(told) == 1
    assert "is damaged" in told[0]
    assert same(first, again)
    assert looked(campaign)[1:] == (0, [])
    file.write_bytes(file.read_bytes()[:-7])
    assert looked(campaign)[1] == 1
    monkeypatch.setattr(kept, "version_of", lambda _: "another")
    _, count, told = looked(campaign)
    assert count == 2
    assert len(told) == 1
    assert "another version's" in told[0]


def test_a_full_disk_is_told_once_and_the_answer_is_the_same(folder: Path) -> None:
    campaign = Campaign((setting("9 N"),))
    folder.parent.mkdir()
    folder.write_text("no folder: nothing can be written into it")
    found, count, told = looked(campaign)
    assert count == 2
    assert len(told) == 1
    assert "is not kept" in told[0]
    assert same(found, campaign.observe(DRAWS))


def test_a_disk_that_gets_full_within_a_record_costs_that_record(folder: Path) -> None:
    campaign = Campaign((setting("9 N"),))
    first, _, _ = looked(campaign)
    (file,) = folder.iterdir()
    whole = file.stat().st_size
    file.unlink()
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (whole - 50, usual[1]))
    try:
        found, count, told = looked(campaign)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert count == 2
    assert [("is not kept" in each) for each in told] == [True]
    again, count, told = looked(campaign)
    assert count == 1
    assert "is damaged" in told[0]
    assert same(first, found)
    assert same(first, again)


def test_what_another_diagnosis_is_writing_is_waited_for(folder: Path) -> None:
    campaign = Campaign((setting("9 N"),))
    looked(campaign)
    (file,) = folder.iterdir()
    content = file.read_bytes()
    with file.open("r+b") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        other.truncate(len(content) - 50)
        answers = list[tuple[Any, int, list[str]]]()
        looking = threading.Thread(target=lambda: answers.append(looked(campaign)))
        looking.start()
        looking.join(0.2)
        assert looking.is_alive()
        other.seek(0)
        other.write(content)
    looking.join(60.0)
    assert answers[0][1:] == (0, [])
