"""`rattle diagnose` and `rattle gap`: where an effect has to be found, another program recorded it.

The log that a twin with a hidden effect wrote serves for what files and words hold.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import pytest

from rig.commands.cli import FAILED, WRONG_USE
from rig.diagnosis import diagnose_runs as diagnosing
from rig.files.effects_file import load_effects
from rig.files.scenario import load_scenario, parse_scenario
from sim_twin.rigs.impact_beam.rig import MODEL
from tests.rig.commands.cli import Answer, Call
from tests.rig.diagnosis.measured_log import BEAM, CRANK, recording, write

FOREIGN = Path(__file__).parents[4] / "shared" / "samples" / "crank_joint_friction.mcap"
HIDDEN = (("clearance", {"scale": 1.6}),)
LOCATIONS = {effect.location for effect in MODEL.effects.values()}


@dataclass(frozen=True)
class Campaign:
    """A run with a hidden effect, its diagnosis, and what the command said."""

    run: Path
    out: Path
    answer: Answer
    content: dict[str, Any]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("runs") / "run.mcap", recording(BEAM, HIDDEN, seed=5), BEAM)


@pytest.fixture(scope="module")
def diagnosed(run: Path) -> dict[str, Campaign]:
    """Kept over the module; filled by the first test that asks."""
    return {}


@pytest.fixture
def campaign(
    run: Path, diagnosed: dict[str, Campaign], call: Call, monkeypatch: pytest.MonkeyPatch
) -> Campaign:
    if not diagnosed:
        # how busy the machine is must not decide what is found
        monkeypatch.setattr(diagnosing, "_OVERTIME", 30.0)
        monkeypatch.setattr(diagnosing, "_LAST", 30.0)
        out = run.parent / "answer"
        out.mkdir()
        (out / "next_experiment.toml").write_text("of an older answer")
        answer = call("diagnose", run, "--out", out, "--budget", 10, "--seed", 3)
        assert answer.code == 0, answer.err
        content = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
        diagnosed["one"] = Campaign(run, out, answer, content)
    return diagnosed["one"]


def test_the_hidden_effect_is_named_in_words_and_files(campaign: Campaign) -> None:
    content = campaign.content
    assert content["verdict"] == "effect"
    assert content["selected"] == ["clearance"]
    best = content["effects"][0]
    assert (best["name"], best["location"]) == ("clearance", "contact joint")
    low, high = best["parameters"]["scale"]["ci95"]
    assert low < best["parameters"]["scale"]["value"] < high
    # 2 % of a healthy clearance, and what thirty cycles leave open
    assert best["parameters"]["scale"]["value"] == pytest.approx(1.6, rel=0.2)
    assert content["gap"]["shrink"] > 0.7
    for word in ("clearance", "diagnosis.json", "effects.json", "report.html", "gap"):
        assert word in campaign.answer.out


def test_no_next_run_of_an_older_answer_stays(campaign: Campaign) -> None:
    following = campaign.out / "next_experiment.toml"
    assert (campaign.content["next_experiment"] is None) == (not following.exists())
    assert not following.exists() or load_scenario(following).rig == "impact_beam"


def test_the_diagnosis_holds_to_the_interface(campaign: Campaign) -> None:
    content = campaign.content
    assert content["schema"] == "rattle.diagnosis/1"
    assert content["runs"] == [str(campaign.run)]
    shares = content["verdict_probability"]
    assert content["verdict"] == max(shares, key=lambda each: shares[each])
    assert sum(shares.values()) == pytest.approx(1.0)
    effects = content["effects"]
    possible = {name for name, effect in MODEL.effects.items()}
    assert sorted(each["name"] for each in effects) == sorted(possible)
    each = [effect["probability"] for effect in effects]
    assert each == sorted(each, reverse=True)
    assert sum(each) + shares["none"] + shares["unknown"] == pytest.approx(1.0)
    for effect in effects:
        assert effect["probability"] <= effect["present"] <= 1
        known = MODEL.effects[effect["name"]]
        assert effect["location"] == known.location
        wanted = {p.name for p in known.parameters} | ({"channel"} if known.channels else set())
        assert set(effect["parameters"]) == wanted
        assert set(effect["indistinguishable_from"]) <= possible - {effect["name"]}
    assert content["horizon_s"] >= 0
    assert content["cost"]["searched"] == 1.0
    assert content["cost"]["simulations"] > 100
    assert all(isfinite(number) for number in _numbers(content))


def test_the_gap_is_told_by_channel_run_band_phase_and_location(campaign: Campaign) -> None:
    block = campaign.content["gap"]
    assert block["before"] > 2
    assert block["shrink"] == pytest.approx(1 - max(block["after"] - 1, 0) / (block["before"] - 1))
    low, high = block["shrink_ci95"]
    assert low <= high <= 1
    assert set(block["by_channel"]) == set(MODEL_CHANNELS)
    assert len(block["by_run"]) == 1
    assert block["by_run"][0] == pytest.approx(block["before"])
    assert {each["channel"] for each in block["by_band"]} == set(MODEL_CHANNELS)
    assert sum(block["by_location"].values()) == pytest.approx(1.0)
    assert set(block["by_location"]) <= {*LOCATIONS, "not known"}
    assert max(block["by_location"], key=lambda one: block["by_location"][one]) == "contact joint"


def test_it_says_what_one_can_argue_with(campaign: Campaign) -> None:
    content = campaign.content
    assert content["runner_up"]
    assert len(content["contrasts"]) == 5
    assert {each["channel"] for each in content["contrasts"]} <= set(MODEL_CHANNELS)
    assert content["runs_alone"] == []  # of one run
    (course,) = content["gap"]["course"]
    assert min(course["before"]) > 1.5 * max(course["after"])
    assert len(content["typical_cycle"]) == 3
    for cycle in content["typical_cycle"]:
        for whose in ("measured", "nominal", "repaired"):
            phase = cycle[whose]["phase"]
            assert phase == sorted(phase)
            assert (phase[0] < 0.01, phase[-1] > 0.98) == (True, True)
    for word in ("in the rig clearance", "why not"):
        assert word in campaign.answer.out


def test_the_next_experiment_is_a_scenario_of_the_same_rig(campaign: Campaign) -> None:
    experiment = campaign.content["next_experiment"]
    scenario = parse_scenario(experiment["scenario"])
    assert scenario.rig == "impact_beam"
    assert set(experiment["separates"]) <= set(MODEL.effects)
    assert len(experiment["separates"]) == 2
    assert 0.5 <= experiment["expected_probability"] <= 1
    # its text is one of its fields
    assert load_scenario(campaign.out / "next_experiment.toml") == scenario


@pytest.mark.long
def test_the_gap_with_the_effects_file_is_what_the_diagnosis_said(campaign: Campaign, call: Call) -> None:
    effects = campaign.out / "effects.json"
    assert [name for name, _ in load_effects(effects, MODEL.effects)] == ["clearance"]
    answer = call("gap", campaign.run, "--effects", effects, "--json")
    assert answer.code == 0, answer.err
    block, said = json.loads(answer.out), campaign.content["gap"]
    # other rigs, and all cycles where the diagnosis judged on half of them
    assert block["before"] == pytest.approx(said["before"], rel=0.2)
    assert block["after"] == pytest.approx(said["after"], rel=0.3)
    assert block["shrink"] > 0.7
    assert set(block) == {*said, "healthy_up_to"}
    assert block["before"] > block["healthy_up_to"] > 1
    assert block["by_location"] == {"contact joint": 1.0}
    assert (campaign.out / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


MODEL_CHANNELS = (
    "drive.force",
    "contact.force_upper",
    "contact.force_lower",
    "yoke.force",
    "base.acceleration",
)


def _numbers(content: Any) -> list[float]:
    if isinstance(content, dict):
        return [number for each in content.values() for number in _numbers(each)]
    if isinstance(content, list):
        return [number for each in content for number in _numbers(each)]
    return [content] if isinstance(content, int | float) else []


def refused(call: Call, tmp_path: Path, *runs: Path) -> tuple[Answer, Answer]:
    """What both commands say; nothing is written."""
    out = tmp_path / "out"
    answers = call("diagnose", *runs, "--out", out), call("gap", *runs)
    assert not out.exists()
    return answers


def test_runs_of_different_rigs_are_wrong_use(call: Call, run: Path, tmp_path: Path) -> None:
    crank = write(tmp_path / "crank.mcap", recording(CRANK), CRANK)
    for answer in refused(call, tmp_path, run, crank):
        assert answer.code == WRONG_USE
        assert "run.mcap is of the impact_beam, crank.mcap is of the planar_slider_crank" in answer.err


def test_a_run_without_its_reference_channel_is_refused_in_one_line(call: Call, tmp_path: Path) -> None:
    bad = write(tmp_path / "bad.mcap", recording(BEAM), BEAM, without={"drive.force"})
    for answer in refused(call, tmp_path, bad):
        assert answer.code == FAILED
        assert answer.err.startswith(f"rattle: {bad}: no drive.force")
        assert answer.err.count("\n") == 1


def test_a_scenario_that_contradicts_the_recording_is_refused(call: Call, tmp_path: Path) -> None:
    bad = write(tmp_path / "bad.mcap", recording(BEAM), BEAM.replace('"20 Hz"', '"22 Hz"'))
    for answer in refused(call, tmp_path, bad):
        assert answer.code == FAILED
        assert "drive.force does not run at the scenario's 22 Hz" in answer.err


def test_a_log_that_is_none_and_one_without_scenario_are_refused(call: Call, tmp_path: Path) -> None:
    bare = write(tmp_path / "bare.mcap", recording(BEAM), None)
    for path, said in ((tmp_path / "absent.mcap", "No such file"), (bare, "no scenario in it")):
        for answer in refused(call, tmp_path, path):
            assert answer.code == FAILED
            assert said in answer.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "Missing argument 'RUN.mcap...'"),
        (("run.mcap",), "Missing option '--out'"),
        (
            ("run.mcap", "--out", "x", "--budget", "1"),
            "'--budget': Input should be greater than or equal to 10",
        ),
        (("run.mcap", "--out", "x", "--seed", "-1"), "greater than or equal to 0"),
    ],
)
def test_wrong_arguments_are_wrong_use(call: Call, arguments: tuple[str, ...], said: str) -> None:
    answer = call("diagnose", *arguments)
    assert answer.code == WRONG_USE
    assert said in answer.err


def test_an_output_that_is_a_file_is_refused(call: Call, run: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    answer = call("diagnose", run, "--out", tmp_path / "out")
    assert answer.code == WRONG_USE
    assert "is a file; name a folder" in answer.err
    assert (tmp_path / "out").read_text() == "mine"


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_simulated(
    call: Call, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def simulated(_count: int) -> None:
        raise AssertionError("simulated before the folder was tried")

    monkeypatch.setattr(diagnosing, "workers_when_needed", simulated)
    (tmp_path / "file").write_text("mine")
    out = tmp_path / "file" / "out"
    answer = call("diagnose", run, "--out", out)
    assert answer.code == WRONG_USE
    assert f"'--out': {tmp_path / 'file'} is a file; name a folder" in answer.err


@pytest.mark.parametrize(
    ("more", "told"), [({}, "rig)"), ({"healthy_up_to": 1.3}, "rig; healthy up to 1.30)")]
)
def test_the_gap_of_one_run_stands_beside_that_of_healthy_rigs(
    call: Call, run: Path, monkeypatch: pytest.MonkeyPatch, more: dict[str, float], told: str
) -> None:
    monkeypatch.setattr(diagnosing, "measured_gap", lambda *_: {"before": 1.2} | more)
    assert f"gap     1.20   (1 = as far as a healthy {told}" in call("gap", run).out


def test_effects_that_the_rig_does_not_have_are_wrong_use(call: Call, run: Path, tmp_path: Path) -> None:
    effects = tmp_path / "effects.json"
    effects.write_text('[{"name": "rod_flexibility", "parameters": {}}]')
    answer = call("gap", run, "--effects", effects)
    assert answer.code == WRONG_USE
    assert "rod_flexibility" in answer.err


@pytest.mark.skipif(not FOREIGN.is_file(), reason=f"no {FOREIGN}")
@pytest.mark.long
def test_the_effect_in_another_program_s_recording_is_found(
    tmp_path: Path, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(diagnosing, "_OVERTIME", 30.0)
    monkeypatch.setattr(diagnosing, "_LAST", 30.0)
    out = tmp_path / "answer"
    assert call("diagnose", FOREIGN, "--out", out, "--budget", 15).code == 0
    content = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    hidden = json.loads(FOREIGN.with_suffix(".json").read_text(encoding="utf-8"))[0]
    assert content["selected"] == [hidden["name"]]
    assert content["effects"][0]["probability"] > 0.8
    found = content["effects"][0]["parameters"]["coefficient"]
    # what eight seconds of a chaotic motion and a healthy rig's tolerances leave open
    assert found["value"] == pytest.approx(hidden["parameters"]["coefficient"], rel=0.3)
    assert content["gap"]["shrink"] > 0.6
