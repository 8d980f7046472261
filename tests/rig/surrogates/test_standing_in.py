"""A surrogate stands in for simulations where its own test allows of it, and nowhere else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.files.surrogate_file import save_surrogate
from rig.surrogates.recordings import Setting
from rig.surrogates.training import trained
from sim_twin.surrogates.judging import Score
from sim_twin.surrogates.surrogate import Surrogate
from tests.rig.commands.cli import Call, caller
from tests.rig.surrogates.crank_logs import write_log

RIGHT = Score(rmse=1.0, rmse_floor=0.9, distance=0.04, distance_floor=0.005)
WRONG = replace(RIGHT, distance=0.6, distance_floor=0.08)


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    return caller(monkeypatch, capfd)


@pytest.fixture(scope="module")
def learnt(tmp_path_factory: pytest.TempPathFactory) -> Surrogate:
    folder = tmp_path_factory.mktemp("logs")
    settings = [Setting(gap, 1, 200) for gap in (0.9, 1.1)]
    logs = [write_log(folder / f"{each.name}.mcap", each, 2.0) for each in settings]
    return trained(logs, "grnn", "angle", None, 0)


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
    answer = call("ensemble", asked, "--runs", 40, "--surrogate", file, "--json")
    assert answer.code == 0, answer.err
    rms = json.loads(answer.out)["figures"]["crank_frame.acceleration_x_rms_m_s2"]
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


def test_a_scenario_that_lies_outside_is_refused(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file = saved(tmp_path, learnt)
    answer = call("ensemble", scenario(tmp_path, Setting(1, 2, 200, "brass")), "--surrogate", file)
    assert answer.code == 1
    assert "lies outside of what it learnt: clearance_2 2 mm, density 8500 kg/m3" in answer.err


def test_one_of_another_rig_is_refused(call: Call, learnt: Surrogate, tmp_path: Path) -> None:
    file = saved(tmp_path, replace(learnt, rig="impact_beam"))
    answer = call("ensemble", scenario(tmp_path, Setting(1, 1, 200)), "--surrogate", file)
    assert answer.code == 2
    assert 'rig = impact_beam: "planar_slider_crank"' in answer.err


def test_one_that_learnt_over_time_is_refused(call: Call, tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.mcap", Setting(1, 1, 200), 2.0)
    file = saved(tmp_path, trained([log], "rbf", "time", 5, 0))
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
