"""`rattle calibrate --spread`: tolerances of a lab from runs of several healthy rigs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.errors import ConfigurationError, RattleError
from rig.diagnosis import diagnose_runs as diagnosing
from rig.diagnosis.lab import lab_text
from rig.diagnosis.recordings import recorded, recorded_alone
from rig.files.model_file import load_model
from rig.files.scenario import parse_scenario
from rig.twin.logged import as_model_text, with_model
from rig.twin.scenario_twin import twin_of
from sim_twin.diagnosis import campaign as simulating
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.spread import Spread
from sim_twin.diagnosis.subject import Draw
from sim_twin.ensembles.simulate import Variant
from sim_twin.healthy import Matched
from sim_twin.twin import AnyTwin
from tests.rig.commands.cli import Call
from tests.rig.commands.test_calibrate import SCENARIO, record
from tests.rig.commands.test_identify import MODEL


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    wide = SCENARIO + '\n[tolerances]\nyoke_frequency = "8 %"\ncontact_stiffness = "20 %"\n'
    return [record(folder / f"rig{seed}.mcap", seed, wide) for seed in range(3)]


def test_what_was_learnt_is_used_as_it_is_written(runs: list[Path], tmp_path: Path) -> None:
    alone = [recorded_alone(run, 20.0) for run in runs]
    names = ("contact_stiffness", "yoke.force.gain", "yoke.force.time", "beam.E")
    widths = np.array([2.0, 1.5, 1.2, 1.8])
    text = lab_text(alone, Spread(names, widths, 1.8, np.ones(4), np.ones(3)), ["a.mcap"])
    assert 'contact_stiffness = "10 %"  # usual 5 %' in text
    assert "# clearance 2 %, drive.amplitude 1 %, drive.frequency 0.02 %." in text
    (tmp_path / "lab.toml").write_text(text)
    scenario = parse_scenario(SCENARIO)
    model = load_model(tmp_path / "lab.toml", "impact_beam")
    twin = with_model(twin_of(scenario), model, scenario, pytest.fail)
    assert twin.widths == pytest.approx(dict(zip(names, widths, strict=True)), rel=0.01)
    drawn = [twin.model.draw_healthy(twin, np.random.default_rng(seed)) for seed in range(200)]
    # 200 draws know a deviation to 5 %; four of them
    assert np.std([each.rig.contact_stiffness for each in drawn]) / 1.5e7 == pytest.approx(0.1, rel=0.2)
    # and as a scenario's own
    table = text[text.index("\n[tolerances]") :]
    assert parse_scenario(f"{SCENARIO}\n{table}").widths == pytest.approx(twin.widths)


def test_what_a_lab_says_besides_is_learnt_and_written_too(runs: list[Path], tmp_path: Path) -> None:
    besides = '\n[tolerances]\npivot_rotation_stiffness = "10 %"\n'
    [first, *_] = (recorded_alone(run, 20.0) for run in runs)
    told = replace(first, scenario=parse_scenario(SCENARIO + besides))
    names = ("contact_stiffness", "pivot_rotation_stiffness")
    text = lab_text([told], Spread(names, np.array([2.0, 0.5]), 1.0, np.ones(2), np.ones(3)), ["a.mcap"])
    assert 'pivot_rotation_stiffness = "5 %"  # was 10 %' in text
    (tmp_path / "lab.toml").write_text(text)
    model, scenario = load_model(tmp_path / "lab.toml", "impact_beam"), told.scenario
    twin = with_model(twin_of(scenario), model, scenario, pytest.fail)
    [turning] = twin.besides
    assert turning.deviation == pytest.approx(0.05)
    # what is written can be read, however far these rigs differ
    wide = lab_text([told], Spread(names, np.array([9.0, 9.0]), 9.0, np.ones(2), np.ones(3)), ["a.mcap"])
    assert 'pivot_rotation_stiffness = "30 %"  # was 10 %' in wide
    [again] = parse_scenario(SCENARIO + wide[wide.index("\n[tolerances]") :]).besides
    assert again.deviation == pytest.approx(0.3)


def test_what_a_lab_says_besides_stays_in_a_calibrated_model(tmp_path: Path) -> None:
    scenario = parse_scenario(f'{SCENARIO}\n[tolerances]\npivot_rotation_stiffness = "12.5 %"\n')
    name, path = "pivot_rotation_stiffness", tmp_path / "model.toml"
    matched = Matched((name,), np.array([2.0]), 0.01 * np.eye(1))
    path.write_text(as_model_text(twin_of(scenario), matched, ["a.mcap"], ["a"]))
    plain = parse_scenario(SCENARIO)
    twin = with_model(twin_of(plain), load_model(path, "impact_beam"), plain, pytest.fail)
    assert twin.rig.rotation_stiffness == pytest.approx(1.25 * twin_of(plain).rig.rotation_stiffness)
    drawn = [twin.model.draw_healthy(twin, np.random.default_rng(seed)) for seed in range(200)]
    stiffness = np.array([each.rig.rotation_stiffness for each in drawn]) / twin.rig.rotation_stiffness
    # 200 draws know a deviation to 5 %; four of them
    assert stiffness.std() == pytest.approx(0.0125, rel=0.2)


def test_runs_of_a_campaign_say_the_same_of_what_rigs_differ_by(runs: list[Path], tmp_path: Path) -> None:
    besides = '\n[tolerances]\npivot_rotation_stiffness = "10 %"\n'
    other = record(tmp_path / "other.mcap", 8, SCENARIO, SCENARIO + besides)
    with pytest.raises(ConfigurationError, match="tolerances"):
        recorded([runs[0], other])


@pytest.mark.parametrize("command", ["diagnose", "gap"])
@pytest.mark.parametrize("said_by", ["scenario", "model"])
def test_the_rigs_of_a_diagnosis_are_as_wide_as_a_lab_says(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, said_by: str
) -> None:
    wide = '[tolerances]\ncontact_stiffness = "20 %"\n'
    run = record(tmp_path / "run.mcap", 1, told=f"{SCENARIO}\n{wide}" if said_by == "scenario" else SCENARIO)
    lab = tmp_path / "lab.toml"
    lab.write_text(f'rig = "impact_beam"\nruns = []\nscenarios = []\n{wide}')
    looked_at: list[Campaign] = []

    def ended(subject: Campaign, *_: object) -> None:
        looked_at.append(subject)
        raise RattleError("seen enough")

    monkeypatch.setattr(diagnosing, "diagnose", ended)
    monkeypatch.setattr(diagnosing, "_simulated", lambda data, *_: ended(data.campaign))
    model = ("--model", lab) if said_by == "model" else ()
    answer = call(command, run, *model, *(("--out", tmp_path / "out") if command == "diagnose" else ()))
    assert "seen enough" in answer.err
    drawn: list[AnyTwin] = []

    def not_simulated(variants: list[Variant], *_: object) -> list[None]:
        drawn.extend(each.twin for each in variants)
        return [None] * len(variants)

    monkeypatch.setattr(simulating, "clean_samples", not_simulated)
    effects = ((), (("structural_damping", {"scale": 4.0}),))
    [campaign] = looked_at
    campaign.observe([Draw(effects[seed % 2], seed) for seed in range(400)])
    for half in (drawn[::2], drawn[1::2]):
        # 200 draws know a deviation to 5 %, four of them; the usual one is 5 %
        assert np.std([each.rig.contact_stiffness for each in half]) / 1.5e7 == pytest.approx(0.2, rel=0.2)


def test_too_few_or_the_same_runs_are_refused(call: Call, runs: list[Path], tmp_path: Path) -> None:
    for given in (runs[:2], [*runs[:2], runs[0]]):
        answer = call("calibrate", "--spread", *given, "-o", tmp_path / "lab.toml")
        assert answer.code == 2
        assert "3 different ones at least" in answer.err
    assert not list(tmp_path.iterdir())


def test_what_is_known_of_the_rigs_values_stands_beside_it(runs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    known = load_model(tmp_path / "model.toml", "impact_beam")
    spread = Spread(("contact_stiffness",), np.array([2.0]), 2.0, np.ones(1), np.ones(3))
    text = lab_text([recorded_alone(runs[0], 20.0)], spread, ["a.mcap"], known)
    (tmp_path / "both.toml").write_text(text)
    scenario = parse_scenario(SCENARIO)
    twin = with_model(
        twin_of(scenario), load_model(tmp_path / "both.toml", "impact_beam"), scenario, pytest.fail
    )
    assert twin.rig.contact_stiffness == 2.4e7
    assert twin.widths["contact_stiffness"] == pytest.approx(2.0, rel=0.01)


def test_a_model_that_says_what_rigs_differ_by_is_learnt_about_by_none(
    call: Call, runs: list[Path], tmp_path: Path
) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text('rig = "impact_beam"\nruns = []\nscenarios = []\n[tolerances]\nbeam_density = "2 %"\n')
    answer = call("calibrate", "--spread", *runs, "--model", lab, "-o", tmp_path / "again.toml")
    assert answer.code == 1
    assert "says already what rigs differ by" in answer.err


def test_runs_of_rigs_that_differ_in_other_things_are_refused_before_any_long_work(
    call: Call, runs: list[Path], tmp_path: Path
) -> None:
    flexible = SCENARIO + '\n[model]\nbase = "flexible"\n'
    other = record(tmp_path / "flexible.mcap", 7, flexible, flexible)
    answer = call("calibrate", "--spread", *runs[:2], other, "-o", tmp_path / "lab.toml")
    assert answer.code == 2
    assert "flexible.mcap and rig0.mcap differ in base." in answer.err
    assert not (tmp_path / "lab.toml").exists()


@pytest.mark.long
def test_rigs_that_differ_by_more_make_wider_tolerances(call: Call, runs: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    answer = call("calibrate", "--spread", *runs, "-o", path, "--rigs", 100)
    assert answer.code == 0, answer.err
    scenario = parse_scenario(SCENARIO)
    twin = with_model(twin_of(scenario), load_model(path, "impact_beam"), scenario, pytest.fail)
    assert "not learnt, for it is set anew for each run: clearance 2 %" in answer.out
    # drawn four times as wide, of which three rigs tell little
    assert twin.widths["yoke_frequency"] > 1.3
