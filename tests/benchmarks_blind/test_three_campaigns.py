"""The blind check at its smallest: three campaigns of another engine, from the seal to the score.

The full check has many more (benchmarks/README.md). Three say nothing of rates, so what is asserted is what a
diagnosis may not get wrong where the answer is plain.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.blind.campaigns import Campaign, chosen
from benchmarks.blind.catalogue import BEAM
from benchmarks.blind.command import ROOT
from benchmarks.blind.runner import diagnosis_file
from benchmarks.blind.seal import unseal

SEED, SETS = 673, ("singles", "healthy", "pairs")
"""A campaign of each on the beam, which is quick, of one run and with effects that stand out."""
PART = ("--sets", *SETS, "--rigs", BEAM, "--each", "1")
FULL_S, SHORT_S = "60", "20"
"""Budgets where a parameter is asserted, and for the others."""
pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("blind")
    _do("make", folder, "--seed", str(SEED), *PART)
    single = next(
        each.name for each in chosen(unseal(folder), SETS, (BEAM,), each=1) if each.kind == "single"
    )
    _do("diagnose", folder, "--only", single, "--budget", FULL_S)
    _do("diagnose", folder, *PART, "--budget", SHORT_S)
    _do("score", folder, *PART)
    return folder


def _do(step: str, folder: Path, *options: str) -> None:
    command = [sys.executable, "-m", "benchmarks.blind", step, str(folder), *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=400)  # noqa: S603 - our own
    assert done.returncode in (0, 1), done.stderr  # 1: a bar missed, as three campaigns may


def campaign_of(folder: Path, kind: str) -> tuple[Campaign, dict[str, Any]]:
    part = chosen(unseal(folder), SETS, (BEAM,), each=1)
    (campaign,) = (each for each in part if each.kind == kind)
    return campaign, json.loads(diagnosis_file(folder, campaign.name).read_text())


def test_the_single_effect_is_named_with_its_parameter(folder: Path) -> None:
    campaign, diagnosis = campaign_of(folder, "single")
    (truth,) = campaign.effects
    first = diagnosis["effects"][0]
    assert first["name"] == truth["name"]
    assert first["probability"] > 0.5
    assert diagnosis["selected"] == [truth["name"]]
    for name, value in truth["parameters"].items():
        assert first["parameters"][name]["value"] == pytest.approx(value, rel=0.15)


def test_nothing_is_named_where_nothing_is_missing(folder: Path) -> None:
    _, diagnosis = campaign_of(folder, "none")
    assert diagnosis["verdict"] == "none"
    assert diagnosis["selected"] == []


def test_a_pair_is_neither_overlooked_nor_taken_for_others(folder: Path) -> None:
    campaign, diagnosis = campaign_of(folder, "pair")
    assert diagnosis["verdict"] == "effect"
    assert diagnosis["selected"]
    assert set(diagnosis["selected"]) <= {effect["name"] for effect in campaign.effects}


def test_all_are_diagnosed_and_scored_by_one_version(folder: Path) -> None:
    scored = (folder / "score.txt").read_text()
    assert "3 of 3 campaigns diagnosed" in scored
    assert "0 failed" in scored
    assert "by 1 version of the program" in scored
