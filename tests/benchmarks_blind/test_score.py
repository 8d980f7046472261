"""From a sealed folder to the printed page, with diagnoses written by hand."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.blind import __main__ as blind
from benchmarks.blind import calibration, command, runner
from benchmarks.blind import score as scoring
from benchmarks.blind import seal as sealing
from benchmarks.blind.calibration import Reference, write_references
from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.cases import Case, Gaps
from benchmarks.blind.catalogue import BEAM, CATALOGUE, EffectEntry
from benchmarks.blind.command import Spent
from benchmarks.blind.figure import Figure, mean_of
from benchmarks.blind.gap import campaign as gaps
from benchmarks.blind.kept import keep, restore
from benchmarks.blind.metrics import first_right
from benchmarks.blind.runner import CALIBRATED
from benchmarks.blind.score import baseline_values, confusion, score
from benchmarks.blind.seal import Frozen, SealBroken, answers_file, frozen_of, seal, sealed, unseal
from benchmarks.blind.table import JUDGED
from benchmarks.kept_results import Results
from tests.benchmarks_blind.stories import CLEARANCE, OUTSIDER, answer, campaign, case

CAMPAIGNS = (
    campaign("none", name="c000", runs=3),
    campaign("strong", OUTSIDER, name="c001"),
    campaign("none", name="c002"),
)


FROZEN = Frozen("abc", "a", 1)


def _diagnosis(none: float, unknown: float, clearance: float) -> dict[str, Any]:
    effects = [
        {"name": name, "location": cause.location, "probability": clearance if name == "clearance" else 0.0}
        for name, cause in CATALOGUE[BEAM].items()
    ]
    return {"verdict_probability": {"none": none, "unknown": unknown}, "effects": effects, "selected": []}


def _write(
    folder: Path, name: str, diagnosis: dict[str, Any], exit_code: int = 0, program: str = "a"
) -> None:
    file = runner.diagnosis_file(folder, name)
    file.parent.mkdir(parents=True)
    file.write_text(json.dumps(diagnosis))
    cost = {
        "wall_s": 70.0,
        "exit_code": exit_code,
        "budget_s": 60.0,
        "effort": 1.0,
        "seed": 0,
        "runs": 1,
        "program_sha256": program,
    }
    (file.parent / "cost.json").write_text(json.dumps(cost))


def _values(folder: Path) -> dict[str, Any]:
    figures = json.loads((folder / "score.json").read_text())["figures"]
    return {figure["what"]: figure["value"] for figure in figures}


def test_the_seal_shows_what_was_changed(tmp_path: Path) -> None:
    seal(tmp_path, CAMPAIGNS, FROZEN)
    assert unseal(tmp_path) == CAMPAIGNS
    file = answers_file(tmp_path)
    file.write_text(file.read_text().replace("loose_cable", "tight_cable"))
    with pytest.raises(SealBroken, match="has changed"):
        unseal(tmp_path)


def test_other_answers_are_not_sealed_over_the_first(tmp_path: Path) -> None:
    digest = seal(tmp_path, CAMPAIGNS, FROZEN)
    assert seal(tmp_path, CAMPAIGNS, FROZEN) == digest
    with pytest.raises(SealBroken, match="name another folder"):
        seal(tmp_path, CAMPAIGNS[:2], FROZEN)


def test_score_of_three_campaigns_of_which_one_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seal(tmp_path, CAMPAIGNS, FROZEN)
    _write(tmp_path, "c000", _diagnosis(0.9, 0.1, 0.0))
    _write(tmp_path, "c001", _diagnosis(0.1, 0.7, 0.2))
    _write(tmp_path, "c002", _diagnosis(1.0, 0.0, 0.0), exit_code=1)
    assert not score(tmp_path, CAMPAIGNS, quick=True)
    values = _values(tmp_path)
    assert values["false alarms when nothing is missing"] == pytest.approx(0.5)
    assert values["unknown, strong: AUROC"] == pytest.approx(0.5)
    assert values["p on the truth (singles shown, none, outside)"] == pytest.approx((0.9 + 0.7) / 3)
    assert values["beam, planar crank, 3 runs: longest, s (baseline: 94)"] == 70
    assert values["refused or failed, of all with three whole cycles"] == pytest.approx(1 / 3)
    printed = capsys.readouterr().out
    assert printed == (tmp_path / "score.txt").read_text() + "\n"
    assert "1 failed: c002" in printed
    assert "MISSED" in printed


@pytest.mark.parametrize(("second", "said"), [("a", "1 version "), ("b", "2 versions ")])
def test_diagnoses_of_two_programs_do_not_pass_though_every_bar_is_met(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    second: str,
    said: str,
) -> None:
    false_alarms = [figure for figure in JUDGED if figure.what == "false alarms when nothing is missing"]
    monkeypatch.setattr(scoring, "JUDGED", false_alarms)
    seal(tmp_path, CAMPAIGNS, FROZEN)
    _write(tmp_path, "c000", _diagnosis(1.0, 0.0, 0.0))
    _write(tmp_path, "c002", _diagnosis(1.0, 0.0, 0.0), program=second)
    assert score(tmp_path, CAMPAIGNS, quick=True) == (second == "a")
    printed = capsys.readouterr().out
    assert f"diagnosed by {said}of the program" in printed
    assert "MISSED" not in printed


def test_what_is_not_diagnosed_yet_is_left_out_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seal(tmp_path, CAMPAIGNS, FROZEN)
    _write(tmp_path, "c001", _diagnosis(0.0, 1.0, 0.0))
    score(tmp_path, CAMPAIGNS, quick=True)
    assert (
        "1 of 3 campaigns diagnosed (1 strong), 0 of them once more by a model of healthy rigs, 0 failed"
        in capsys.readouterr().out
    )


def test_a_file_that_is_no_diagnosis_counts_as_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seal(tmp_path, CAMPAIGNS, FROZEN)
    _write(tmp_path, "c000", {"schema": "something else"})
    score(tmp_path, CAMPAIGNS, quick=True)
    assert "1 failed: c000" in capsys.readouterr().out


def test_confusion_counts_first_answers_and_leaves_pairs_out() -> None:
    said = answer({"clearance": 0.6, "none": 0.4})
    cases = [
        case("single", said, CLEARANCE),
        case("none", said),
        case("none", None),
        case("pair", said, CLEARANCE),
    ]
    expected = {"clearance": {"clearance": 1}, "none": {"clearance": 1, "(failed)": 1}}
    assert confusion(cases) == expected


def test_baselines_are_judged_by_the_same_figures() -> None:
    said = answer({"clearance": 0.6, "none": 0.4}, shrinks={"clearance": 0.9})
    values = baseline_values([case("single", said, CLEARANCE), case("none", said)])
    assert values.keys() == {"random", "majority", "best residual", "oracle"}
    first = next(row for row, figure in enumerate(JUDGED) if figure.what.endswith("shown: first right"))
    assert values["oracle"][first] == values["best residual"][first] == 1


def test_a_share_has_wilsons_interval_and_no_case_has_none() -> None:
    figure = Figure("right", list[Case], mean_of(first_right), "wilson")
    said = answer({"clearance": 1.0})
    measured = figure.measure([case("single", said, CLEARANCE)] * 3 + [case("none", said)])
    assert measured.value == pytest.approx(0.75)
    assert measured.interval == pytest.approx((0.3006, 0.9544), abs=5e-5)  # Wilson, 3 of 4
    assert figure.measure([]).interval is None


def test_a_diagnosis_that_takes_too_long_is_stopped(tmp_path: Path) -> None:
    output = tmp_path / "output.txt"
    assert command.run([sys.executable, "-c", "import time; time.sleep(60)"], output, 0.3).exit_code is None
    assert command.run([sys.executable, "-c", "raise SystemExit(3)"], output, 30.0).exit_code == 3


def test_memory_is_that_of_a_command_and_all_that_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "_LOOK_S", 0.05)
    child = "held = bytearray(b'x' * 60_000_000); import time; time.sleep(0.6)"
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}])"
    spent = command.run([sys.executable, "-c", parent], tmp_path / "output.txt", 30.0)
    # its 60 MB and two interpreters
    assert 60 < spent.memory_mb < 150
    assert 0 < spent.cpu_s < spent.wall_s + 1


def test_only_what_is_not_diagnosed_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("c000", "c001"):
        (tmp_path / "logs" / name).mkdir(parents=True)
        (tmp_path / "logs" / name / f"{name}_run1.mcap").touch()
    _write(tmp_path, "c000", _diagnosis(1.0, 0.0, 0.0))
    commands = []

    def noted(arguments: list[str], _output: Path, limit_s: float) -> Spent:
        commands.append((arguments, limit_s))
        return Spent(50.0, 80.0, 0, 900.0)

    monkeypatch.setattr(runner, "rattle", noted)
    runner.diagnose_all(tmp_path, ["c000", "c001"], 60.0, 2.0)
    ((arguments, limit_s),) = commands
    assert arguments[:2] == ["diagnose", str(tmp_path / "logs" / "c001" / "c001_run1.mcap")]
    assert arguments[-6:] == ["--seed", "1", "--budget", "60", "--effort", "2"]
    assert limit_s == 3600
    assert not any("sealed" in part for part in arguments)
    cost = runner.cost_of(tmp_path, "c001")
    assert cost is not None
    assert cost.runs == 1


def test_a_campaign_of_a_lab_is_diagnosed_once_more_by_its_healthy_rigs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_lab = replace(campaign("none", name="c002", of_set="modes"), lab="a", same_rig="h003")
    lab = [replace(of_lab, name=f"h00{n}", kind="reference", same_rig="") for n in range(3)]
    own = replace(of_lab, name="h003", kind="reference")
    write_references(tmp_path, [*lab, own, of_lab, CAMPAIGNS[0]])
    assert calibration.references(tmp_path) == {"c002": Reference(("h000", "h001", "h002"), "h003")}
    for name in ("h000", "h001", "h002", "h003", "c002"):
        (tmp_path / "logs" / name).mkdir(parents=True)
        (tmp_path / "logs" / name / f"{name}_run1.mcap").touch()
    commands = []

    def noted(arguments: list[str], _output: Path, _limit_s: float) -> Spent:
        commands.append([part.removeprefix(f"{tmp_path}/") for part in arguments])
        if arguments[0] == "calibrate":
            Path(arguments[-1]).touch()
        return Spent(50.0, 80.0, 0, 900.0)

    monkeypatch.setattr(runner, "rattle", noted)
    monkeypatch.setattr(calibration, "rattle", noted)
    for _ in range(2):  # the second time there is nothing left to do
        runner.diagnose_all(tmp_path, ["c002"])
    plain, spread, same_rig, calibrated = commands
    assert "--model" not in plain
    healthy = [f"logs/h00{n}/h00{n}_run1.mcap" for n in range(3)]
    assert spread == ["calibrate", *healthy, "--spread", "-o", "models/h000.toml"]
    own_log = "logs/h003/h003_run1.mcap"
    known = ["--model", "models/h000.toml", "--known-healthy"]
    assert same_rig == ["calibrate", own_log, *known, "-o", "models/h003.toml"]
    assert calibrated[-2:] == ["--model", "models/h003.toml"]
    assert calibrated[3] == f"diagnoses/c002{CALIBRATED}"


def test_a_failed_calibration_is_a_miss_and_not_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = []

    def failing(arguments: list[str], _output: Path, _limit_s: float) -> Spent:
        tried.append(arguments[0])
        return Spent(1.0, 1.0, 3, 10.0)

    monkeypatch.setattr(calibration, "rattle", failing)
    for _ in range(2):
        assert calibration.model_of(tmp_path, Reference(("h000",), "h001")) is None
    assert tried == ["calibrate"]


def test_wrong_pages_have_their_figures_with_and_without_calibration(tmp_path: Path) -> None:
    of_labs = tuple(campaign("none", name=f"c00{n}", of_set="modes") for n in range(2))
    seal(tmp_path, of_labs, FROZEN)
    _write(tmp_path, "c000", _diagnosis(0.1, 0.8, 0.1))
    _write(tmp_path, "c001", _diagnosis(0.1, 0.1, 0.8))
    _write(tmp_path, f"c000{CALIBRATED}", _diagnosis(0.9, 0.1, 0.0))
    _write(tmp_path, f"c001{CALIBRATED}", _diagnosis(0.9, 0.1, 0.0), exit_code=1)
    score(tmp_path, of_labs)
    values = _values(tmp_path)
    assert values["wrong page, calibrated: healthy called healthy"] == 0.5
    assert values["wrong page, as it is: unknown, of wrong answers"] == 0.5
    assert values["modes, as it is: healthy called healthy"] == 0
    # what is judged beside is of the right page alone
    assert values["false alarms when nothing is missing"] is None


def test_what_is_wired_wrongly_has_a_row_of_its_own_and_counts_in_no_other(tmp_path: Path) -> None:
    turned: EffectEntry = {"name": "sensor_factor", "parameters": {"channel": "yoke.force", "factor": -1.0}}
    wired = tuple(campaign("wired", turned, name=f"c00{n}", of_set="wired") for n in range(2))
    seal(tmp_path, wired, FROZEN)
    named = _diagnosis(0.1, 0.0, 0.0)
    named["effects"].append({"name": "sensor_factor", "location": "sensor", "probability": 0.9})
    _write(tmp_path, "c000", named)
    _write(tmp_path, "c001", _diagnosis(0.0, 0.2, 0.8))
    score(tmp_path, wired, quick=True)
    values = _values(tmp_path)
    assert values["wired wrongly, shown: first right"] == 0.5
    assert values["wired wrongly, shown: among three"] == 0.5
    assert values["beam, single effects shown: first right"] is None
    assert values["calibration error above the perfectly calibrated"] is None
    assert "sensor_factor" in json.loads((tmp_path / "score.json").read_text())["confusion"]


def test_a_program_other_than_the_frozen_one_does_not_pass(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scoring, "JUDGED", JUDGED[:1])
    for folder, program in ((tmp_path / "same", "a"), (tmp_path / "other", "b")):
        seal(folder, CAMPAIGNS, FROZEN)
        _write(folder, "c000", _diagnosis(1.0, 0.0, 0.0), program=program)
        assert score(folder, CAMPAIGNS, quick=True) == (program == "a")
    assert "which is NOT what diagnosed" in capsys.readouterr().out


def test_what_was_kept_on_another_machine_scores_as_it_did_there(tmp_path: Path) -> None:
    here, there, results = tmp_path / "here", tmp_path / "there", Results(tmp_path / "kept", "a")
    hidden = campaign("single", CLEARANCE, name="c003")
    campaigns = (*CAMPAIGNS, hidden)
    seal(here, campaigns, FROZEN)
    seal(there, campaigns, FROZEN)
    for each, none in zip(campaigns, (1.0, 0.2, 0.7, 0.1), strict=True):
        _write(here, each.name, {**_diagnosis(none, 0.0, 1.0 - none), "causes": "much else"})
    effects = runner.effects_file(here, hidden.name)
    effects.write_text(json.dumps([CLEARANCE]))
    gaps._write(gaps._gaps_file(here, hidden), {"before": 3.0, "oracle": 1.0})
    answered = gaps._answer_file(here, hidden)
    assert answered is not None
    gaps._write(answered, 1.5)
    for each in campaigns:
        keep(here, 5, each, results)
    assert all(restore(there, 5, each, results) for each in campaigns)
    assert not restore(there, 6, hidden, results)
    assert not restore(there, 5, replace(hidden, rig_seed=1 + hidden.rig_seed), results)
    for folder in (here, there):
        score(folder, campaigns, quick=True)
    assert (here / "score.json").read_text() == (there / "score.json").read_text()
    (told,) = (each for each in json.loads((there / "score.json").read_text())["campaigns"] if each["gap"])
    assert told["gap"] == {"before": 3.0, "oracle": 1.0, "after": 1.5}


def test_answers_of_another_program_are_not_kept_as_this_one_s(tmp_path: Path) -> None:
    _write(tmp_path, CAMPAIGNS[0].name, _diagnosis(1.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="answers of another program"):
        keep(tmp_path, 5, CAMPAIGNS[0], Results(tmp_path / "kept", "b"))


def test_what_a_failed_diagnosis_said_last_is_kept(tmp_path: Path) -> None:
    _write(tmp_path, CAMPAIGNS[0].name, _diagnosis(1.0, 0.0, 0.0), exit_code=1)
    (tmp_path / "diagnoses" / CAMPAIGNS[0].name / "output.txt").write_text(f"{'-' * 5000} no whole cycle")
    results = Results(tmp_path / "kept", "a")
    keep(tmp_path, 5, CAMPAIGNS[0], results)
    (kept,) = results.every("*")
    assert kept["files"][f"diagnoses/{CAMPAIGNS[0].name}/output.txt"].endswith("no whole cycle")


@pytest.mark.parametrize(("code", "stopped"), [(0, False), (1, False), (runner.NO_MODEL, False), (-9, True)])
def test_what_a_signal_ended_is_no_answer(tmp_path: Path, code: int, stopped: bool) -> None:
    _write(tmp_path, "c000", {}, exit_code=code)
    assert runner.was_stopped(tmp_path, "c000") == stopped


def test_a_campaign_that_was_kept_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []

    def diagnose(folder: Path, names: list[str], *_: object) -> None:
        done.extend(names)
        for name in names:
            _write(folder, name, _diagnosis(1.0, 0.0, 0.0), program=runner.program_digest())

    monkeypatch.setattr(blind, "make", lambda *_: None)
    monkeypatch.setattr(blind, "is_recorded", lambda *_: True)
    frozen = Frozen("abc", runner.program_digest(), 5)
    monkeypatch.setattr(blind, "measure_gaps", lambda *_: None)
    monkeypatch.setattr(blind, "diagnose_all", diagnose)
    for machine, more in (("one", 1), ("another", 2)):
        seal(tmp_path / machine, CAMPAIGNS, frozen)
        asked = argparse.Namespace(
            folder=tmp_path / machine, seed=5, results=tmp_path / "kept", more=more,
            budget=None, effort=1.0, discard_logs=False,
        )  # fmt: skip
        blind._by_parts(asked, CAMPAIGNS, CAMPAIGNS)
    assert done == [each.name for each in CAMPAIGNS]
    assert runner.cost_of(tmp_path / "another", CAMPAIGNS[0].name) is not None


@pytest.mark.parametrize("ended", ["killed", "no gap", "whole"])
def test_what_is_not_done_is_neither_kept_nor_discarded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ended: str
) -> None:
    hidden, discarded = campaign("single", CLEARANCE, name="c003"), list[str]()

    def diagnose(folder: Path, names: list[str], *_: object) -> None:
        code = -9 if ended == "killed" else 0
        _write(folder, names[0], _diagnosis(0.0, 0.0, 1.0), code, program=runner.program_digest())
        if ended != "no gap":
            gaps._write(gaps._gaps_file(folder, hidden), {"before": 3.0, "oracle": 1.0})

    monkeypatch.setattr(blind, "make", lambda *_: None)
    monkeypatch.setattr(blind, "is_recorded", lambda *_: True)
    monkeypatch.setattr(blind, "measure_gaps", lambda *_: None)
    monkeypatch.setattr(blind, "diagnose_all", diagnose)
    monkeypatch.setattr(blind, "discard_logs", lambda _, each: discarded.append(each.name))
    seal(tmp_path / "check", [hidden], Frozen("abc", runner.program_digest(), 5))
    asked = argparse.Namespace(
        folder=tmp_path / "check", seed=5, results=tmp_path / "kept", more=None,
        budget=None, effort=1.0, discard_logs=True,
    )  # fmt: skip
    blind._by_parts(asked, [hidden], [hidden])
    kept = Results(tmp_path / "kept", runner.program_digest()).every("*")
    assert (len(kept), discarded) == ((1, ["c003"]) if ended == "whole" else (0, []))
    assert (runner.cost_of(tmp_path / "check", "c003") is None) == (ended == "killed")


def test_a_folder_of_another_program_is_refused_before_any_work(tmp_path: Path) -> None:
    seal(tmp_path / "check", CAMPAIGNS, FROZEN)
    asked = argparse.Namespace(folder=tmp_path / "check", seed=5, results=tmp_path / "kept")
    with pytest.raises(SealBroken, match="begun by another program"):
        blind._by_parts(asked, CAMPAIGNS, CAMPAIGNS)


def test_campaigns_are_drawn_once_for_the_program_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []

    def draw(seed: int) -> tuple[Campaign, ...]:
        drawn.append(seed)
        return CAMPAIGNS

    monkeypatch.setattr(sealing, "commit", lambda: "abc")
    assert sealed(tmp_path, 5, draw) == CAMPAIGNS == sealed(tmp_path, 5, draw)
    assert drawn == [5]
    assert frozen_of(tmp_path) == Frozen("abc", runner.program_digest(), 5)
    with pytest.raises(SealBroken, match="another seed"):
        sealed(tmp_path, 6, draw)


def test_a_score_that_was_stopped_measures_only_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hidden = tuple(campaign("single", CLEARANCE, name=f"c00{n}") for n in range(2))
    file = tmp_path / "gaps" / "c000.json"
    file.parent.mkdir()
    file.write_text(json.dumps({"before": 3.0, "oracle": 1.0}))
    asked = []
    monkeypatch.setattr(gaps, "_known_runs", lambda _folder, one: asked.append(one.name) or iter(()))
    assert gaps.truth_gaps(tmp_path, hidden[0]) == Gaps(3.0, 1.0)
    assert asked == []
    # quick: what was not measured counts as shown and has no shrink
    assert scoring._known_gaps(tmp_path, hidden) == {"c000": Gaps(3.0, 1.0, 3.0)}
    assert gaps.answer_gap(tmp_path, hidden[1]) is None
    assert asked == []
    with pytest.raises(FileNotFoundError, match="logs of c001 are not there"):
        gaps.truth_gaps(tmp_path, hidden[1])
    assert asked == ["c001"]


def test_the_answers_name_every_campaign_once() -> None:
    names = [each.name for each in CAMPAIGNS]
    assert [Campaign.from_json(each.as_json()).name for each in CAMPAIGNS] == names
