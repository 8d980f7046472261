"""The rehearsal: its files are right, and each command of its script is one that rattle has."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import NoReturn

import pytest

from daq.errors import RattleError
from rig.files.bench import load_bench
from rig.files.scenario import load_scenario
from rig.twin.scenario_twin import twin_of, with_effects
from tests.rig.commands.cli import Call, caller

ROOT = Path(__file__).parents[2]
BENCH = ROOT / "scenarios" / "rehearsal.bench.toml"
SCENARIO = ROOT / "scenarios" / "impact_beam.toml"
STAND_IN = """#!/usr/bin/env bash
printf '%q ' "$@" >> calls
echo >> calls
if [ "$1" = run ]; then touch "${@: -1}/run.mcap"; fi
"""


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    return caller(monkeypatch, capfd)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The script in a project whose `rattle` only notes how it was called."""
    for name, text in {"scripts/setup": "#!/bin/sh\n", ".venv/bin/rattle": STAND_IN}.items():
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    shutil.copy(ROOT / "scripts" / "rehearse", tmp_path / "scripts")
    shutil.copytree(ROOT / "scenarios", tmp_path / "scenarios")
    return tmp_path


def rehearse(project: Path) -> str:
    return subprocess.run(  # noqa: S603
        [project / "scripts" / "rehearse"], cwd="/", check=True, capture_output=True, text=True
    ).stdout


def test_the_bench_is_sound_and_hides_an_effect_that_the_twin_can_have(call: Call) -> None:
    answer = call("check", BENCH)
    assert answer.code == 0, answer.err
    hidden = load_bench(BENCH).emulation.effects
    assert hidden is not None
    nominal = twin_of(load_scenario(SCENARIO))
    assert with_effects(nominal, hidden) != nominal


def test_each_command_is_shown_and_is_one_that_rattle_has(
    project: Path, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = rehearse(project)
    calls = (project / "calls").read_text().splitlines()
    assert [shlex.split(each)[0] for each in calls] == ["run", "diagnose", "overlay"]

    def ready(*_: object) -> NoReturn:
        raise RattleError("ready to run")

    monkeypatch.setattr("rig.session.run.run_scenario", ready)
    monkeypatch.chdir(project)
    for each, ends in zip(calls, ("ready to run", "not a log", "not a log"), strict=True):
        assert f"$ .venv/bin/rattle {each.strip()}" in shown
        assert ends in call(*shlex.split(each)).err


def test_it_may_be_called_again_and_ends_with_what_to_open(project: Path) -> None:
    pages = [rehearse(project).splitlines()[-1].strip() for _ in range(2)]
    assert len(set(pages)) == 2
    assert all(os.path.isabs(page) for page in pages)
