"""`rattle calibrate`: a model from a reference run, used by --model; what it must refuse."""

from __future__ import annotations

import errno
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.errors import ConfigurationError, RattleError
from daq.log.writer import LogWriter
from rig.diagnosis import calibration
from rig.diagnosis.calibration import Calibration
from rig.diagnosis.diagnose_runs import recorded_of
from rig.diagnosis.recordings import recorded
from rig.files.model_file import load_model, parse_model
from rig.files.scenario import parse_scenario
from rig.session.progress import Screen, Terminal
from rig.twin.logged import campaign_with_model, carried, with_model
from rig.twin.scenario_twin import predicted_channels, twin_of
from sim_twin.diagnosis.matching import Match
from sim_twin.healthy import Matched
from sim_twin.sensors import SensorChain
from sim_twin.twin import AnyTwin
from tests.rig.commands.cli import Call

RATE, SECONDS = 25_600.0, 1.2
SCENARIO = """
name = "reference"
rig = "impact_beam"

[drive]
frequency = "20 Hz"

[acquisition]
sample_rate = "25.6 kHz"
duration = "1.2 s"
"""


def record(path: Path, seed: int, scenario: str = SCENARIO, told: str = SCENARIO) -> Path:
    """A run of a healthy rig of a scenario by the exact solver; the log holds what was `told` of it."""
    twin = twin_of(parse_scenario(scenario))
    model, rng = twin.model, np.random.default_rng(seed)
    healthy = model.draw_healthy(twin, rng, rng)
    stream = model.stream(healthy, RATE, rng)
    stream.drive(healthy.drive, float(rng.uniform(0, 2 * np.pi)))
    stream.advance(round(RATE))
    write(path, predicted_channels(healthy), stream.advance(round(SECONDS * RATE)), told)
    return path


def write(
    path: Path,
    channels: tuple[Channel, ...],
    samples: np.ndarray,
    scenario: str = SCENARIO,
    begin_ns: int = 0,
) -> None:
    step = round(0.1 * RATE)
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": scenario})
        for channel in channels:
            log.declare("measured", channel)
        for first in range(0, samples.shape[1], step):
            time_ns = sample_time_ns(begin_ns, first, RATE)
            for channel, row in zip(channels, samples, strict=True):
                block = SampleBlock(
                    channel.name, first, time_ns, RATE, row[first : first + step].astype(np.float32)
                )
                log.add_block("measured", block, time_ns)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("reference") / "reference.mcap", seed=6)


def nominal() -> AnyTwin:
    return twin_of(parse_scenario(SCENARIO))


@pytest.mark.long
def test_a_reference_run_gives_a_model_that_predictions_use(
    call: Call, reference: Path, tmp_path: Path
) -> None:
    model_path = tmp_path / "model.toml"
    answer = call("calibrate", reference, "-o", model_path, "--rigs", 100)
    assert answer.code == 0, answer.err
    assert "yoke_frequency" in answer.out
    assert re.search(r"gap +[01]\.\d\d with the model", answer.out)
    model = load_model(model_path, "impact_beam")
    assert (model.runs, model.scenarios) == (("reference.mcap",), ("reference",))
    matched = with_model(nominal(), model, parse_scenario(SCENARIO), pytest.fail)
    assert matched.rig.yoke_frequency == pytest.approx(
        700 * (1 + 0.02 * model.matched.mean_of("yoke_frequency"))
    )

    scenario = tmp_path / "scenario.toml"
    scenario.write_text(SCENARIO)
    plain = call("predict", scenario, "--out", tmp_path / "plain.mcap", "--json")
    fitted = call("predict", scenario, "--model", model_path, "--out", tmp_path / "fitted.mcap", "--json")
    assert fitted.code == 0, fitted.err
    values = [json.loads(each.out)["first_peak_n"] for each in (plain, fitted)]
    assert values[0] != values[1]
    # Tolerances of section 5 move the first peak by some per cent, no more.
    assert values[1] == pytest.approx(values[0], rel=0.1)
    again = call("calibrate", reference, "-o", model_path)
    assert again.code == 1
    assert "is there already" in again.err


def test_a_run_with_a_fault_gives_no_model(
    call: Call, reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = Match(Matched(("yoke.force.gain",), np.array([9.0]), np.array([[0.1]])), 20.0)
    monkeypatch.setattr(calibration, "calibrated", lambda *_: Calibration(far))
    answer = call("calibrate", reference, "-o", tmp_path / "model.toml")
    assert answer.code == 1
    assert "not of a healthy rig" in answer.err
    assert "too much of yoke.force.gain" in answer.err
    assert not (tmp_path / "model.toml").exists()


def test_runs_of_two_rigs_give_no_model(call: Call, reference: Path, tmp_path: Path) -> None:
    """Whatever lies between them, told before any long work; another run of the same rig is no other rig."""
    other = record(tmp_path / "other.mcap", 5, f'{SCENARIO}\n[model]\nyoke_frequency = "500 Hz"\n')
    answer = call("calibrate", reference, other, "-o", tmp_path / "model.toml", "--rigs", 2000)
    assert answer.code == 1
    assert "reference.mcap and other.mcap were recorded at one setting and differ in" in answer.err
    assert "yoke.force" in answer.err
    assert not (tmp_path / "model.toml").exists()


def test_two_runs_of_healthy_rigs_are_calibrated_together(
    call: Call, reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ended(*_: object) -> Match:
        raise RattleError("seen enough")

    monkeypatch.setattr(calibration, "match", ended)
    other = record(tmp_path / "other.mcap", 9)
    answer = call("calibrate", reference, other, "-o", tmp_path / "model.toml")
    assert "seen enough" in answer.err


def full_disk(patch: pytest.MonkeyPatch) -> None:
    """Where nothing can be brought to the disk any more."""

    def fsync(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    patch.setattr(os, "fsync", fsync)


def test_a_disk_that_is_full_keeps_no_part_of_a_model(
    call: Call, reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin = recorded([reference]).campaign.runs[0].twin
    names = tuple(each.name for each in twin.model.lasting_tolerances(twin))
    near = Match(Matched(names, np.zeros(len(names)), 0.1 * np.eye(len(names))), 0.5)
    monkeypatch.setattr(calibration, "calibrated", lambda *_: Calibration(near))
    full_disk(monkeypatch)
    path = tmp_path / "model.toml"
    answer = call("calibrate", reference, "-o", path)
    assert answer.code == 1
    assert f"cannot write {path}: No space left on device" in answer.err
    assert not list(tmp_path.iterdir())


MODEL = """
rig = "impact_beam"
runs = ["a.mcap"]
scenarios = ["a"]

[[tolerances]]
name = "contact_stiffness"
nominal = 1.5e7
mean = 2.0
deviation = 0.1
correlations = []

[[tolerances]]
name = "yoke.force.gain"
nominal = 1.0
mean = -1.0
deviation = 0.3
correlations = [0.0]
"""


def test_a_part_that_was_changed_since_is_open_again(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(MODEL)
    model, told = load_model(path, "impact_beam"), list[str]()
    other = parse_scenario(SCENARIO + '\n[model]\ncontact_stiffness = "2e7 N/m"\n')
    twin = with_model(twin_of(other), model, other, told.append)
    assert twin.rig.contact_stiffness == 2e7
    yoke = twin.sensors["yoke.force"]
    assert isinstance(yoke, SensorChain)
    assert yoke.gain == pytest.approx(0.99)
    assert told == ["not as it was calibrated, so its tolerance is open again: contact_stiffness"]
    assert carried(model, [nominal(), twin_of(other)], told.append).names == ("yoke.force.gain",)


OTHER = MODEL.replace("[[", 'specimen = "beam 3"\n[[', 1)
"""The same of a specimen that the runs below are not of."""
REFUSED = 'specimen = "beam 3": "beam 7", which scenario or runs are of'


def noted(specimen: str) -> str:
    return f'{SCENARIO}\n[notes]\nspecimen = "{specimen}"\n'


@pytest.fixture(scope="module")
def of_beam_7(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("noted") / "noted.mcap", 4, told=noted("beam 7"))


@pytest.mark.parametrize(
    ("command", "options"),
    [("gap", ()), ("diagnose", ("--out",)), ("calibrate", ("-o",)), ("overlay", ("-o",))],
)
def test_a_calibration_of_another_specimen_is_not_used_on_runs(
    call: Call, of_beam_7: Path, tmp_path: Path, command: str, options: tuple[str, ...]
) -> None:
    model, out = tmp_path / "model.toml", tmp_path / "out"
    model.write_text(OTHER)
    more = [part for option in options for part in (option, out)]
    answer = call(command, of_beam_7, "--model", model, *more)
    assert answer.code == 2
    assert f"{model}:\n  {REFUSED}" in answer.err
    assert "calibrate that one, or leave --model out" in answer.err
    assert not out.exists()


@pytest.mark.parametrize(("command", "options"), [("predict", ("--out",)), ("ensemble", ())])
def test_a_calibration_of_another_specimen_is_not_used_on_a_scenario(
    call: Call, tmp_path: Path, command: str, options: tuple[str, ...]
) -> None:
    model, scenario, out = (tmp_path / name for name in ("model.toml", "scenario.toml", "p.mcap"))
    model.write_text(OTHER)
    scenario.write_text(noted("beam 7"))
    more = [part for option in options for part in (option, out)]
    answer = call(command, scenario, "--model", model, *more)
    assert answer.code == 2
    assert f"{model}:\n  {REFUSED}" in answer.err
    assert not out.exists()


def test_a_model_of_which_nobody_can_tell_whose_it_is_is_told(
    reference: Path, of_beam_7: Path, tmp_path: Path
) -> None:
    model, screen = tmp_path / "model.toml", Screen(Terminal())

    def told(run: Path, text: str) -> list[str]:
        model.write_text(text)
        remarks = recorded_of([run], model, screen).remarks
        return [each.partition(":")[0] for each in remarks if "specimen" in each]

    assert told(reference, MODEL) == [f"no specimen is named by {model} and these runs"]
    assert told(of_beam_7, MODEL) == [f"no specimen is named by {model}"]
    assert told(reference, OTHER) == ["no specimen is named by these runs"]
    assert told(of_beam_7, OTHER.replace("beam 3", "beam 7")) == []
    lab = 'rig = "impact_beam"\nruns = []\nscenarios = []\n[tolerances]\ncontact_stiffness = "8 %"\n'
    assert told(reference, lab) == []  # which is of many rigs


def test_a_calibration_is_used_where_nothing_says_that_it_is_of_another(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(OTHER)
    for specimen in (None, "beam 3"):
        assert load_model(path, "impact_beam", specimen).specimen == "beam 3"
    with pytest.raises(ConfigurationError, match=r'specimen = "beam 3": "beam 7"'):
        load_model(path, "impact_beam", "beam 7")
    path.write_text(MODEL)
    assert load_model(path, "impact_beam", "beam 7").specimen is None


def test_a_spread_about_a_model_of_another_specimen_says_so() -> None:
    """Its runs are of several."""
    model, told = parse_model(OTHER, "model", "impact_beam"), list[str]()
    for specimen in ("beam 3", "beam 7"):
        with_model(nominal(), model, parse_scenario(noted(specimen)), told.append)
    assert told == ["the model is of another specimen, beam 3; this is beam 7"]


@pytest.mark.parametrize("command", ["calibrate", "diagnose", "gap"])
def test_runs_of_two_specimens_are_refused(call: Call, reference: Path, tmp_path: Path, command: str) -> None:
    other, out = record(tmp_path / "other.mcap", 4, told=noted("beam 7")), tmp_path / "out"
    options = {"calibrate": ("-o", out), "diagnose": ("--out", out)}
    answer = call(command, reference, other, *options.get(command, ()))
    assert answer.code == 2
    assert "other.mcap is of beam 7: runs of one rig" in answer.err
    assert not out.exists()


def test_a_campaign_is_matched_as_a_whole(reference: Path, tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(MODEL)
    campaign = campaign_with_model(
        recorded([reference]).campaign,
        load_model(path, "impact_beam"),
        [parse_scenario(SCENARIO)],
        pytest.fail,
    )
    assert campaign.runs[0].twin.rig.contact_stiffness == pytest.approx(1.5e7 * 1.1)


def test_a_model_of_another_rig_is_refused(call: Call, tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    scenario = Path("scenarios/planar_slider_crank.toml")
    answer = call("predict", scenario, "--model", tmp_path / "model.toml", "--out", tmp_path / "p.mcap")
    assert answer.code == 2
    assert "the rig of the scenario" in answer.err
