"""From a sealed folder to the printed page, with diagnoses written by hand."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.blind import runner
from benchmarks.blind import score as scoring
from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.cases import Case
from benchmarks.blind.catalogue import BEAM, CATALOGUE
from benchmarks.blind.figure import Figure, mean_of
from benchmarks.blind.metrics import first_right
from benchmarks.blind.score import baseline_values, confusion, score
from benchmarks.blind.seal import SealBroken, answers_file, seal, unseal
from benchmarks.blind.table import JUDGED
from tests.benchmarks_blind.stories import CLEARANCE, OUTSIDER, answer, campaign, case

CAMPAIGNS = (
    campaign("none", name="c000", runs=3),
    campaign("outside", OUTSIDER, name="c001"),
    campaign("none", name="c002"),
)


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
        "seed": 0,
        "runs": 1,
        "program_sha256": program,
    }
    (file.parent / "cost.json").write_text(json.dumps(cost))


def _values(folder: Path) -> dict[str, Any]:
    figures = json.loads((folder / "score.json").read_text())["figures"]
    return {figure["what"]: figure["value"] for figure in figures}


def test_the_seal_shows_what_was_changed(tmp_path: Path) -> None:
    seal(tmp_path, CAMPAIGNS)
    assert unseal(tmp_path) == CAMPAIGNS
    file = answers_file(tmp_path)
    file.write_text(file.read_text().replace("loose_cable", "tight_cable"))
    with pytest.raises(SealBroken, match="has changed"):
        unseal(tmp_path)


def test_other_answers_are_not_sealed_over_the_first(tmp_path: Path) -> None:
    digest = seal(tmp_path, CAMPAIGNS)
    assert seal(tmp_path, CAMPAIGNS) == digest
    with pytest.raises(SealBroken, match="name another folder"):
        seal(tmp_path, CAMPAIGNS[:2])


def test_score_of_three_campaigns_of_which_one_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seal(tmp_path, CAMPAIGNS)
    _write(tmp_path, "c000", _diagnosis(0.9, 0.1, 0.0))
    _write(tmp_path, "c001", _diagnosis(0.1, 0.7, 0.2))
    _write(tmp_path, "c002", _diagnosis(1.0, 0.0, 0.0), exit_code=1)
    assert not score(tmp_path)
    values = _values(tmp_path)
    assert values["false alarms when nothing is missing"] == pytest.approx(0.5)
    assert values["unknown: AUROC"] == pytest.approx(0.5)
    assert values["probability on the truth (singles shown, none, outside)"] == pytest.approx((0.9 + 0.7) / 3)
    assert values["three runs: longest wall time, s"] == 70
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
    seal(tmp_path, CAMPAIGNS)
    _write(tmp_path, "c000", _diagnosis(1.0, 0.0, 0.0))
    _write(tmp_path, "c002", _diagnosis(1.0, 0.0, 0.0), program=second)
    assert score(tmp_path) == (second == "a")
    printed = capsys.readouterr().out
    assert f"diagnosed by {said}of the program" in printed
    assert "MISSED" not in printed


def test_what_is_not_diagnosed_yet_is_left_out_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seal(tmp_path, CAMPAIGNS)
    _write(tmp_path, "c001", _diagnosis(0.0, 1.0, 0.0))
    score(tmp_path)
    assert "1 of 3 campaigns diagnosed (1 outside), 0 failed" in capsys.readouterr().out


def test_a_file_that_is_no_diagnosis_counts_as_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seal(tmp_path, CAMPAIGNS)
    _write(tmp_path, "c000", {"schema": "something else"})
    score(tmp_path)
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
    first = next(row for row, figure in enumerate(JUDGED) if figure.what.endswith("first answer right"))
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
    assert runner._run([sys.executable, "-c", "import time; time.sleep(60)"], output, 0.3) is None
    assert runner._run([sys.executable, "-c", "raise SystemExit(3)"], output, 30.0) == 3


def test_only_what_is_not_diagnosed_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("c000", "c001"):
        (tmp_path / "logs" / name).mkdir(parents=True)
        (tmp_path / "logs" / name / f"{name}_run1.mcap").touch()
    _write(tmp_path, "c000", _diagnosis(1.0, 0.0, 0.0))
    commands = []

    def noted(command: list[str], _output: Path, limit_s: float) -> int:
        commands.append((command, limit_s))
        return 0

    monkeypatch.setattr(runner, "_run", noted)
    runner.diagnose_all(tmp_path, 60.0)
    ((command, limit_s),) = commands
    assert command[3:5] == ["diagnose", str(tmp_path / "logs" / "c001" / "c001_run1.mcap")]
    assert command[-4:] == ["--seed", "1", "--budget", "60"]
    assert limit_s == 480
    assert not any("sealed" in part for part in command)
    cost = runner.cost_of(tmp_path, "c001")
    assert cost is not None
    assert cost.runs == 1


def test_the_answers_name_every_campaign_once() -> None:
    names = [each.name for each in CAMPAIGNS]
    assert [Campaign.from_json(each.as_json()).name for each in CAMPAIGNS] == names
