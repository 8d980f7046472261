"""`rattle surrogate`: it learns from logs, speaks beside a log, and says what it cannot do."""

from __future__ import annotations

import hashlib
import json
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.log.reader import SURROGATE, LogReader
from daq.log.recover import verify_log
from rig.files.surrogate_file import load_surrogate
from rig.surrogates.recordings import Setting
from rig.twin.recorded_samples import RIG, samples_of
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS, ANGLE
from tests.rig.commands.cli import Answer, Call
from tests.rig.commands.test_overlay import RUN as BEAM
from tests.rig.surrogates.crank_logs import NOISE, RATE, shown, write_log
from tests.rig.synthetic_run import write_log as write_beam_log

SETTINGS = [Setting(gap, 1, speed) for gap in (1, 2) for speed in (150, 200)]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    return [write_log(folder / f"{each.name}.mcap", each) for each in SETTINGS]


def train(call: Call, logs: list[Path], out: Path, *more: object) -> Answer:
    return call("surrogate", "train", *logs, "-o", out, "--network", "grnn", "--units", 300, *more)


def test_it_learns_and_says_from_what_and_how_well(call: Call, logs: list[Path], tmp_path: Path) -> None:
    answer = train(call, logs, tmp_path / "crank.npz")
    assert answer.code == 0, answer.err
    assert "learnt     speed 150 to 200 rpm" in answer.out
    assert "learnt     clearance_2 1 mm; the same in all runs, so nothing was learnt of it" in answer.out
    assert str(tmp_path / "crank.npz") in answer.out.splitlines()[-1]
    with zipfile.ZipFile(tmp_path / "crank.npz") as packed:
        about = json.loads(packed.read("surrogate.json"))
    assert about["logs"] == {log.name: hashlib.sha256(log.read_bytes()).hexdigest() for log in logs}
    # noise of 0.05 about what repeats, and what a network makes of a revolution
    assert all(0.8 < each["rmse"] / each["rmse_floor"] < 2.5 for each in about["tested"].values())


@pytest.mark.long
def test_it_speaks_beside_measurement_and_twin(call: Call, logs: list[Path], tmp_path: Path) -> None:
    assert train(call, logs, tmp_path / "crank.npz").code == 0
    before, target = logs[0].read_bytes(), tmp_path / "beside.mcap"
    answer = call("surrogate", "predict", logs[0], tmp_path / "crank.npz", "-o", target)
    assert answer.code == 0, answer.err
    assert logs[0].read_bytes() == before
    assert verify_log(target).sound
    with LogReader(target) as log:
        assert list(log.channels(SURROGATE)) == list(ACCELERATIONS)
        assert set(log.channels("predicted")) == {*ACCELERATIONS, ANGLE}
        measured, said = log.table("measured"), log.table(SURROGATE)
        for name in ACCELERATIONS:
            apart = said[name].values - measured[name].values
            assert (said[name].first_sample, said[name].time_ns) == (0, measured[name].time_ns)
            assert np.sqrt(np.mean(apart**2)) < 4 * NOISE
        assert log.metadata["surrogate"]["network"] == "grnn"
        assert len(json.loads(log.metadata["surrogate"]["logs"])) == len(logs)
        model = (tmp_path / "crank.npz").read_bytes()
        assert log.metadata["surrogate"]["file"] == f"crank.npz {hashlib.sha256(model).hexdigest()}"
        assert [event.code for event in log.events() if event.source == "surrogate"] == ["surrogate.learnt"]
    assert "it learnt from this run: what it says beside it is no prediction" in " ".join(answer.out.split())
    page = target.with_suffix(".html").read_text(encoding="utf-8")
    assert '<span class="surrogate">surrogate</span>' in page
    assert "Revolutions in the mean:" in page
    assert "Not judged: RATTLE_HEALTHY_RIGS is 0." in page
    replayed = call("replay", target, "--speed", "0")
    assert replayed.code == 0, replayed.err


def test_what_lies_outside_of_what_it_learnt_is_flagged(call: Call, logs: list[Path], tmp_path: Path) -> None:
    assert train(call, logs, tmp_path / "crank.npz").code == 0
    faster = write_log(tmp_path / "faster.mcap", Setting(1, 2, 230), seconds=1.0)
    answer = call("surrogate", "predict", faster, tmp_path / "crank.npz", "-o", tmp_path / "beside.mcap")
    assert answer.code == 0, answer.err
    told = "speed 230 rpm, where it learnt 150 to 200"
    assert told in " ".join(answer.out.split())
    assert "it learnt from this run" not in " ".join(answer.out.split())
    with LogReader(tmp_path / "beside.mcap") as log:
        texts = [event.text for event in log.events() if event.code == "surrogate.outside"]
    assert texts == [told, "clearance_2 2 mm, where it learnt 1"]


def still(setting: Setting, seconds: float) -> dict[str, np.ndarray]:
    """A crank that stands."""
    rows = shown(setting, seconds)
    return {**rows, ANGLE: np.full(len(rows[ANGLE]), 1.0)}


@pytest.mark.parametrize(
    ("given", "code", "told"),
    [
        (
            lambda folder: write_beam_log(folder / "a.mcap", 0.2, scenario=BEAM),
            1,
            "surrogates are of the planar_slider_crank",
        ),
        (
            lambda folder: write_log(folder / "a.mcap", SETTINGS[0], leave_out=ACCELERATIONS[1]),
            1,
            f"{ACCELERATIONS[1]} not measured",
        ),
        (
            lambda folder: write_log(folder / "a.mcap", SETTINGS[0], spoil=ACCELERATIONS[2]),
            1,
            f"{ACCELERATIONS[2]} has no value that is finite",
        ),
        (
            lambda folder: write_log(folder / "a.mcap", SETTINGS[0], seconds=0.5),
            1,
            "nothing can be learnt from 1 logs: fewer than 3 revolutions",
        ),
        (
            lambda folder: write_log(folder / "a.mcap", SETTINGS[0], seconds=0.001),
            1,
            "samples are too few to learn from",
        ),
        (
            lambda folder: write_log(folder / "a.mcap", Setting(1, 1, 150, "cheese"), seconds=0.5),
            2,
            "model.material",
        ),
        (
            lambda folder: write_log(folder / "a.mcap", SETTINGS[0], seconds=0.5, show=still),
            1,
            "every input is the same in all samples",
        ),
        (lambda folder: folder / "none.mcap", 1, "No such file"),
    ],
)
def test_what_cannot_be_learnt_from_is_refused(
    call: Call, tmp_path: Path, given, code: int, told: str
) -> None:
    answer = train(call, [given(tmp_path)], tmp_path / "crank.npz")
    assert answer.code == code
    assert told in answer.err
    assert not (tmp_path / "crank.npz").exists()


def test_a_floor_that_nobody_knows_is_not_said_to_be_nothing(call: Call, tmp_path: Path) -> None:
    """The last fifth of five revolutions has not two whole ones, which would tell the scatter."""
    log = write_log(tmp_path / "short.mcap", Setting(1, 1, 150), seconds=2.0)
    answer = train(call, [log], tmp_path / "crank.npz")
    assert answer.code == 0, answer.err
    lines = [line.split() for line in answer.out.splitlines() if line.startswith(ACCELERATIONS)]
    assert [line[-1] for line in lines] == ["-"] * 3
    (tmp_path / "s.toml").write_text(Setting(1, 1, 150).scenario(2.0), encoding="utf-8")
    answer = call("ensemble", tmp_path / "s.toml", "--surrogate", tmp_path / "crank.npz")
    assert answer.code == 1
    assert "not two whole revolutions" in answer.err
    assert "times as far off" not in answer.err


@pytest.mark.long
def test_samples_count_once(call: Call, logs: list[Path], tmp_path: Path) -> None:
    """Also those of a copy with predictions in it, which lies beside its run."""
    assert train(call, logs, tmp_path / "crank.npz").code == 0
    run = tmp_path / "run.mcap"
    run.write_bytes(logs[0].read_bytes())
    assert call("surrogate", "predict", run, tmp_path / "crank.npz").code == 0
    beside = tmp_path / "run.surrogate.mcap"
    assert beside.is_file()
    answer = train(call, [run, beside, run], tmp_path / "again.npz")
    assert answer.code == 0, answer.err
    told = "".join(answer.out.split())  # without its line breaks
    assert f"{beside}hasthemeasuredsamplesof{run};theycountonce" in told
    assert train(call, [run], tmp_path / "once.npz").code == 0
    again, once = (load_surrogate(tmp_path / name, RIG) for name in ("again.npz", "once.npz"))
    assert again.learnt_from.keys() == {"run.mcap"}
    assert np.array_equal(again.network.prototypes_, once.network.prototypes_)


def test_a_copy_of_a_copy_keeps_nothing_of_an_earlier_surrogate(
    call: Call, logs: list[Path], tmp_path: Path
) -> None:
    assert train(call, logs, tmp_path / "crank.npz").code == 0
    outside = write_log(tmp_path / "faster.mcap", Setting(1, 2, 230), seconds=1.0)
    assert call("surrogate", "predict", outside, tmp_path / "crank.npz").code == 0
    assert call("overlay", tmp_path / "faster.surrogate.mcap", "-o", tmp_path / "plain.mcap").code == 0
    with LogReader(tmp_path / "plain.mcap") as log:
        assert "surrogate" not in log.metadata
        assert not [event for event in log.events() if event.source == "surrogate"]


def test_units_are_added_until_the_goal(call: Call, logs: list[Path], tmp_path: Path) -> None:
    units = {}
    for goal in (0.5, 0.2):
        out = tmp_path / f"{goal}.npz"
        answer = call("surrogate", "train", logs[0], "-o", out, "--units", 60, "--error-goal", goal)
        assert answer.code == 0, answer.err
        units[goal] = len(np.load(out)["centres_"])
    assert units[0.5] < units[0.2] < 60
    answer = train(call, logs, tmp_path / "crank.npz", "--error-goal", 0.1)
    assert answer.code == 2
    assert "a grnn adds no units" in answer.err


def test_the_speed_is_the_measured_one(tmp_path: Path) -> None:
    """Ordered were 200 rpm, and 198 were turned."""
    slower = write_log(
        tmp_path / "slower.mcap", Setting(1, 1, 200), 1.0,
        show=lambda setting, seconds: shown(replace(setting, speed=198), seconds),
    )  # fmt: skip
    with LogReader(slower) as log:
        assert samples_of(log, 20).column("speed") == pytest.approx(198, abs=0.05)


def test_samples_at_a_lower_rate_are_filtered(tmp_path: Path) -> None:
    """At 1280 Hz a tone of 1300 Hz would show as one of 20 Hz; one of 100 Hz stays, at its times."""

    def tones(setting: Setting, seconds: float) -> dict[str, np.ndarray]:
        rows = shown(setting, seconds)
        times = np.arange(len(rows[ANGLE])) / RATE
        waves = (np.sin(2 * np.pi * hz * times).astype(np.float32) for hz in (100, 1300, 100))
        return dict(zip(ACCELERATIONS, waves, strict=True)) | {ANGLE: rows[ANGLE]}

    with LogReader(write_log(tmp_path / "tones.mcap", Setting(1, 1, 200), 1.0, show=tones)) as log:
        found = samples_of(log, 20)
    times = found.column("time")
    assert found.outputs[:, 0] == pytest.approx(np.sin(2 * np.pi * 100 * times), abs=1e-3)
    assert np.abs(found.outputs[:, 1]).max() < 1e-3
    turned = 2 * np.pi * 200 / 60 * times + 0.3
    assert found.column("angle") == pytest.approx(turned, abs=2e-3)
    assert np.diff(times) == pytest.approx(1 / 1280)


def test_a_file_in_the_way_and_a_damaged_one_are_said(call: Call, logs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "crank.npz").write_bytes(b"in the way")
    answer = train(call, logs, tmp_path / "crank.npz")
    assert answer.code == 1
    assert "is there already" in answer.err
    answer = train(call, logs, tmp_path / "nowhere" / "crank.npz")
    assert answer.code == 1
    assert "no such folder; nothing was trained" in answer.err
    answer = call("surrogate", "predict", logs[0], tmp_path / "crank.npz", "-o", tmp_path / "beside.mcap")
    assert answer.code == 1
    assert "damaged, or no surrogate" in answer.err
    assert not (tmp_path / "beside.mcap").exists()


def test_a_run_of_another_rig_or_without_a_channel_is_refused(
    call: Call, logs: list[Path], tmp_path: Path
) -> None:
    assert train(call, logs, tmp_path / "crank.npz").code == 0
    beam = write_beam_log(tmp_path / "beam.mcap", 0.2, scenario=BEAM)
    answer = call("surrogate", "predict", beam, tmp_path / "crank.npz")
    assert answer.code == 2
    assert 'rig = planar_slider_crank: "impact_beam", the rig that is asked for' in answer.err
    fewer = write_log(tmp_path / "fewer.mcap", SETTINGS[0], 0.5, leave_out=ACCELERATIONS[0])
    answer = call("surrogate", "predict", fewer, tmp_path / "crank.npz")
    assert answer.code == 2
    assert f"channels = {ACCELERATIONS[0]}: only what the run has" in answer.err
    no_angle = write_log(tmp_path / "no_angle.mcap", SETTINGS[0], 0.5, leave_out=ANGLE)
    answer = call("surrogate", "predict", no_angle, tmp_path / "crank.npz")
    assert answer.code == 1
    assert f"{ANGLE} not measured, which a surrogate goes by" in answer.err
    assert not list(tmp_path.glob("*.surrogate.mcap"))


@pytest.mark.long
def test_runs_are_judged_and_the_second_call_has_it_at_once(
    call: Call, logs: list[Path], tmp_path: Path
) -> None:
    answer = call("surrogate", "report", *logs, logs[0], "--out", tmp_path / "judged")
    assert answer.code == 0, answer.err
    assert "they count once" in answer.out
    assert "of many, the RBF network is ahead of the GRNN (explained" in answer.out
    assert "other speeds" not in answer.out  # there are but two
    table = json.loads((tmp_path / "judged" / "surrogates.json").read_text(encoding="utf-8"))
    by = {(row["split"], row["learnt"], row["over"], row["method"]): row["score"] for row in table["rows"]}
    assert by["held-out cycles", "all", "angle", "GRNN, 500 units"]["rmse"] < 0.2  # noise of 0.05, and smooth
    assert by["held-out cycles", "all", "time", "GRNN, 500 units"]["rmse"] > 0.5
    first = (tmp_path / "judged" / "surrogates.html").read_text(encoding="utf-8")
    text = (tmp_path / "judged" / "surrogates.md").read_text(encoding="utf-8")
    assert "| held-out cycles | all | angle |" in text
    begun = time.monotonic()
    assert call("surrogate", "report", *logs, "--out", tmp_path / "judged").code == 0
    assert time.monotonic() - begun < 30.0
    assert (tmp_path / "judged" / "surrogates.html").read_text(encoding="utf-8") == first
