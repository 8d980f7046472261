"""A surrogate stands in for simulations where its own test allows of it, and nowhere else."""

from __future__ import annotations

import csv
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.files.scenario import parse_scenario
from rig.files.surrogate_file import save_surrogate
from rig.surrogates.recordings import Setting
from rig.surrogates.training import trained
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.planar_slider_crank.channels import ANGLE
from sim_twin.surrogates.judging import Score
from sim_twin.surrogates.surrogate import Surrogate
from tests.rig.commands.cli import Call, caller
from tests.rig.surrogates.crank_logs import shown, write_log

RIGHT = Score(rmse=1.0, rmse_floor=0.9, distance=0.04, distance_floor=0.005)
WRONG = replace(RIGHT, distance=0.6, distance_floor=0.08)


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    return caller(monkeypatch, capfd)


@pytest.fixture(scope="module")
def learnt(tmp_path_factory: pytest.TempPathFactory) -> Surrogate:
    folder = tmp_path_factory.mktemp("logs")
    settings = [
        Setting(0.9, 0.9, 199), Setting(0.9, 1.1, 201), Setting(1.1, 0.9, 201), Setting(1.1, 1.1, 199)
    ]  # fmt: skip
    logs = [write_log(folder / f"{each.name}.mcap", each, 2.0) for each in settings]
    return trained(logs, "grnn", "angle", units=400)


def saved(folder: Path, surrogate: Surrogate, score: Score = RIGHT) -> Path:
    tested = dict.fromkeys(surrogate.channels, score)
    save_surrogate(replace(surrogate, tested=tested), folder / "crank.npz")
    return folder / "crank.npz"


def scenario(folder: Path, setting: Setting) -> Path:
    (folder / "s.toml").write_text(setting.scenario(2.0), encoding="utf-8")
    return folder / "s.toml"


@pytest.mark.parametrize(
    ("score", "right"),
    [
        (RIGHT, True),
        (WRONG, False),
        (replace(WRONG, distance_floor=0.31), True),
        (replace(WRONG, distance=0.17), False),
    ],
)
def test_a_distribution_is_right_within_twice_the_rigs_own_scatter(score: Score, right: bool) -> None:
    assert score.distribution_right is right


def test_it_tells_what_many_rigs_show(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file, asked = saved(tmp_path, learnt), scenario(tmp_path, Setting(1, 1, 200))
    given = (
        "ensemble",
        asked,
        "--runs",
        40,
        "--surrogate",
        file,
        "--settings-only",
        "--out",
        tmp_path / "runs.csv",
    )
    answer = call(*given, "--json")
    assert answer.code == 0, answer.err
    told = json.loads(answer.out)
    by = "by surrogate crank.npz (grnn of 4 runs of one rig), not simulated"
    assert told["by"] == by
    assert by in call(*given).out
    with (tmp_path / "runs.csv").open(encoding="utf-8", newline="") as file_of_runs:
        assert {row["by"] for row in csv.DictReader(file_of_runs)} == {by}
    twin = twin_of(parse_scenario(asked.read_text(encoding="utf-8")))
    simulated = twin.model.solver_values(twin, 0.0, 0.02)
    assert set(told["figures"]) < set(simulated)  # of the same names and units as a simulation's
    rms = told["figures"]["crank_frame.acceleration_x_rms_m_s2"]
    assert rms["runs"] == 40
    # a sine of an amplitude of twice the clearance in mm, which healthy rigs spread by 2 %
    assert rms["mean"] == pytest.approx(2 / np.sqrt(2), rel=0.1)


def test_where_its_own_test_forbids_it_nothing_is_told(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file = saved(tmp_path, learnt, WRONG)
    answer = call("ensemble", scenario(tmp_path, Setting(1, 1, 200)), "--surrogate", file)
    assert answer.code == 1
    assert "not good enough to stand in" in answer.err
    assert "7.5 times as far off" in answer.err
    assert answer.out == ""


def test_tolerances_that_it_knows_nothing_of_are_named(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file = saved(tmp_path, learnt)
    answer = call("ensemble", scenario(tmp_path, Setting(1, 1, 200)), "--surrogate", file)
    assert answer.code == 1
    told = " ".join(answer.err.split())
    assert "healthy rigs also differ by crank_length, rod_length," in told
    assert "restitution" in told
    assert "clearance_1" not in told
    assert ".gain" not in told  # which figures are before
    assert "--settings-only" in told


def test_a_rig_that_lies_outside_is_refused(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file = saved(tmp_path, learnt)
    given = ("--surrogate", file, "--settings-only", "--runs", 50)
    answer = call("ensemble", scenario(tmp_path, Setting(1, 2, 200, "brass")), *given)
    assert answer.code == 1
    told = " ".join(answer.err.split())
    assert "50 of 50 rigs" in told
    assert re.search(r"clearance_2 [\d.]+ to [\d.]+ mm, where it learnt 0.9 to 1.1", told)
    assert "density 8500 kg/m3, where it learnt 7800" in told
    # the nominal rig lies inside, some of those like it do not
    answer = call("ensemble", scenario(tmp_path, Setting(1.09, 1, 200)), *given)
    assert answer.code == 1
    count = int(re.search(r"(\d+) of 50 rigs", answer.err)[1])
    assert 5 < count < 35


def test_what_only_a_surrogate_leaves_out_needs_one(call: Call, tmp_path: Path) -> None:
    answer = call("ensemble", scenario(tmp_path, Setting(1, 1, 200)), "--settings-only")
    assert answer.code == 2
    assert "only what a surrogate stands in for" in answer.err


def stepping(setting: Setting, seconds: float) -> dict[str, np.ndarray]:
    """Three times as much in the last tenth, half of what is tested: halves differ, revolutions do not."""
    rows = shown(setting, seconds)
    sizes = np.where(np.arange(len(rows[ANGLE])) < 0.9 * len(rows[ANGLE]), 1.0, 3.0)
    return {name: row if name == ANGLE else row * sizes for name, row in rows.items()}


def by_turn(setting: Setting, seconds: float) -> dict[str, np.ndarray]:
    """A size of its own in every revolution, as much the second and the fourth as any."""
    rows = shown(setting, seconds)
    turns = np.floor(rows[ANGLE] / (2 * math.pi)).astype(int)
    sizes = np.random.default_rng(0).normal(size=turns.max() + 1)
    return {name: row if name == ANGLE else row * sizes[turns] for name, row in rows.items()}


@pytest.mark.long
@pytest.mark.parametrize(("show", "right"), [(shown, True), (stepping, False), (by_turn, False)])
def test_only_one_that_its_own_test_finds_right_may_stand_in(tmp_path: Path, show, right: bool) -> None:
    logs = [write_log(tmp_path / f"{gap}.mcap", Setting(gap, 1, 300), 6.0, show=show) for gap in (1, 2)]
    assert trained(logs, "grnn", "angle", units=300).stands_in is right


def test_one_of_another_rig_is_refused(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file = saved(tmp_path, replace(learnt, rig="impact_beam"))
    answer = call("ensemble", scenario(tmp_path, Setting(1, 1, 200)), "--surrogate", file)
    assert answer.code == 2
    assert 'rig = impact_beam: "planar_slider_crank"' in answer.err


def test_one_that_learnt_over_time_is_refused(call: Call, tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.mcap", Setting(1, 1, 200), 2.0)
    file = saved(tmp_path, trained([log], "rbf", "time", 5))
    answer = call("ensemble", scenario(tmp_path, Setting(1, 1, 200)), "--surrogate", file)
    assert answer.code == 1
    assert "it learnt over time" in answer.err


def test_an_effect_is_none_of_a_surrogates(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file, effects = saved(tmp_path, learnt), tmp_path / "effects.json"
    effects.write_text('[{"name": "restitution", "parameters": {"value": 0.5}}]', encoding="utf-8")
    asked = scenario(tmp_path, Setting(1, 1, 200))
    answer = call("ensemble", asked, "--surrogate", file, "--effects", effects)
    assert answer.code == 2
    assert "a surrogate knows no effects" in answer.err


def test_of_an_unknown_material_the_scenario_says_so(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file = saved(tmp_path, learnt)
    answer = call("ensemble", scenario(tmp_path, Setting(1, 1, 200, "cheese")), "--surrogate", file)
    assert answer.code == 2
    assert "model.material" in answer.err
