"""`rattle overlay`: a prediction beside recordings of other programs and beside what a crash left."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from daq.errors import LogError
from daq.log.front import CUT, read_summary
from daq.log.reader import LogReader, Origin
from daq.log.recover import verify_log
from rig.derived.settings import RECORD
from rig.files.software import software
from rig.report.record import read_run
from rig.report.summary import closeness, half_cycle_statistics, overall
from rig.session.overlay import overlay_run
from tests.daq.log.logs import copied_by_others
from tests.rig.commands.cli import Call
from tests.rig.derived.test_live_and_replay import logged, replayed
from tests.rig.session.fakes import silent_screen
from tests.rig.synthetic_run import SCENARIO, write_log

RUN = f'{SCENARIO}\n[acquisition]\nsample_rate = "51.2 kHz"\nduration = "2 s"\n'
SAMPLES = Path(__file__).parents[3].parent / "shared" / "samples"
BOTH: tuple[Origin, ...] = ("measured", "predicted")
FRAME = ("crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y")
needs_samples = pytest.mark.skipif(not SAMPLES.is_dir(), reason="no recordings of other programs beside here")


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@needs_samples
def test_a_foreign_recording_gets_its_prediction_in_a_new_file(call: Call, tmp_path: Path) -> None:
    run = SAMPLES / "beam_healthy.mcap"
    before = digest(run)
    answer = call("overlay", run, "-o", tmp_path / "overlay.mcap")
    assert answer.code == 0, answer.err
    assert digest(run) == before
    assert (tmp_path / "overlay.html").is_file()
    assert verify_log(tmp_path / "overlay.mcap").sound
    with LogReader(run) as original, LogReader(tmp_path / "overlay.mcap") as log:
        records = {name: record for name, record in log.metadata.items() if name != RECORD}
        assert records == {**original.metadata, "twin": {"effects": "[]", **software()}}
        assert list(log.channels("predicted")) == list(log.channels("measured"))
        for name, row in original.table("measured").items():
            copied, predicted = log.series("measured", name), log.series("predicted", name)
            assert np.array_equal(copied.values, row.values)
            assert (predicted.time_ns, predicted.end_sample) == (row.time_ns, row.end_sample)


def test_what_follows_from_both_comes_with_them_and_is_said(call: Call, tmp_path: Path) -> None:
    run = write_log(tmp_path / "run.mcap", 2.0, origins=["measured"], scenario=RUN)
    target = tmp_path / "overlay.mcap"
    answer = call("overlay", run, "-o", target)
    assert answer.code == 0, answer.err
    with LogReader(target) as log:
        found = {origin: [each for each in log.impacts() if each.origin == origin] for origin in BOTH}
        assert set(log.metadata[RECORD]) == {"rule", *BOTH}
    assert len(found["measured"]) == 80  # 40 on each side of the gap; the twin hits both sides too
    assert {impact.channel for impact in found["predicted"]} >= {"contact.force_upper", "contact.force_lower"}
    told = [line for line in answer.out.splitlines() if line.endswith("half cycles)")]
    assert [line.split()[0] for line in told] == ["measured", "predicted"]
    assert "(80 half cycles)" in told[0]
    assert replayed(target) == logged(target)


def test_how_much_is_predicted_goes_by_the_record_not_by_what_was_asked(tmp_path: Path) -> None:
    """Of a run until Enter that is a day."""
    asked = RUN.replace('"2 s"', '"86400 s"')
    run = write_log(tmp_path / "run.mcap", 0.5, origins=["measured"], scenario=asked)
    screen, told = silent_screen(), list[tuple[float, float]]()
    screen.stages.append(lambda text, done, total, *_: told.append((done, total)))
    overlay_run(run, tmp_path / "overlay.mcap", screen=screen)
    assert told[-1] == (pytest.approx(0.5), pytest.approx(0.5))


@needs_samples
def test_a_healthy_foreign_rig_is_close_to_its_prediction(tmp_path: Path) -> None:
    overlay_run(SAMPLES / "beam_healthy.mcap", tmp_path / "overlay.mcap")
    run = read_run(tmp_path / "overlay.mcap")
    measured, predicted = (half_cycle_statistics(run, origin) for origin in ("measured", "predicted"))
    assert measured is not None
    assert predicted is not None
    for name, sd in (("first_mean_n", "first_sd_n"), ("max_mean_n", "max_sd_n")):
        # twice the error of independent half cycles, three sigma, and 3 % for a healthy rig
        error = np.hypot(*(getattr(peaks, sd) / np.sqrt(peaks.count) for peaks in (measured, predicted)))
        allowed = 6 * error + 0.03 * getattr(predicted, name)
        assert getattr(measured, name) == pytest.approx(getattr(predicted, name), abs=allowed)
    for name, channel in run.channels.items():
        predicted_rms = run.tallies["predicted", name].rms
        if channel.unit == "N":
            assert run.tallies["measured", name].rms == pytest.approx(predicted_rms, rel=0.15)


@needs_samples
def test_an_effect_can_be_given_to_the_prediction(tmp_path: Path) -> None:
    run, effects = SAMPLES / "beam_base_flexibility.mcap", SAMPLES / "beam_base_flexibility.json"
    overlay_run(run, tmp_path / "overlay.mcap", effects)
    assert verify_log(tmp_path / "overlay.mcap").sound
    rms: dict[Origin, float] = {}
    with LogReader(tmp_path / "overlay.mcap") as log:
        for origin in ("measured", "nominal", "predicted"):
            rms[origin] = float(np.std(log.series(origin, "base.acceleration").values))
        assert log.metadata["twin"]["effects"] == effects.read_text()
        assert log.metadata["twin"]["nominal"] == "without these effects"
    # a base that is rigid does not move; the repaired one moves as the recorded one within chaos
    assert rms["nominal"] < 0.1 * rms["measured"]
    assert rms["predicted"] == pytest.approx(rms["measured"], rel=0.3)
    found = overall(closeness(read_run(tmp_path / "overlay.mcap")))
    # the recording's halves differ by 0.3 dB, and a healthy rig by its tolerances
    assert found.repaired_db < 1.5 < 5.0 < found.nominal_db


@needs_samples
def test_a_healthy_foreign_crank_is_close_to_its_prediction(tmp_path: Path) -> None:
    overlay_run(SAMPLES / "crank_healthy.mcap", tmp_path / "overlay.mcap")
    measured, predicted = (rms_of(tmp_path / "overlay.mcap", origin) for origin in ("measured", "predicted"))
    for channel in FRAME:
        # 8 s of the rms of a frame acceleration scatter by about 10 %, and the frame's damping by 15 %
        assert predicted[channel] == pytest.approx(measured[channel], rel=0.35)


@needs_samples
def test_the_predicted_crank_turns_with_the_measured_one(tmp_path: Path) -> None:
    overlay_run(SAMPLES / "crank_healthy.mcap", tmp_path / "overlay.mcap")
    with LogReader(tmp_path / "overlay.mcap") as log:
        angles = [log.series(origin, "crank.angle").values for origin in ("measured", "predicted")]
    apart = np.abs(np.asarray(angles[0], dtype=float) - angles[1])
    # the encoder's counts, and what is left of the fit of its speed over 8 s
    assert apart.max() < 3 * 2 * np.pi / 4096


@needs_samples
def test_friction_in_a_foreign_cranks_joints_closes_its_gap(tmp_path: Path) -> None:
    run, effects = SAMPLES / "crank_joint_friction.mcap", SAMPLES / "crank_joint_friction.json"
    overlay_run(run, tmp_path / "overlay.mcap", effects)
    log = tmp_path / "overlay.mcap"
    measured, nominal, repaired = (rms_of(log, origin) for origin in ("measured", "nominal", "predicted"))
    for channel in FRAME[:2]:
        assert nominal[channel] > 1.7 * measured[channel]
        assert repaired[channel] == pytest.approx(measured[channel], rel=0.35)


def rms_of(log: Path, origin: Origin) -> dict[str, float]:
    with LogReader(log) as read:
        return {name: float(np.std(read.series(origin, name).values)) for name in FRAME}


def test_the_nominal_twin_beside_a_repaired_one_is_the_one_of_a_plain_overlay(
    call: Call, tmp_path: Path
) -> None:
    run = write_log(tmp_path / "run.mcap", seconds=0.5, origins=["measured"], scenario=RUN)
    effects = tmp_path / "effects.json"
    effects.write_text('[{"name": "structural_damping", "parameters": {"scale": 6.0}}]')
    overlay_run(run, tmp_path / "plain.mcap")
    answer = call("overlay", run, "--effects", effects, "-o", tmp_path / "both.mcap")
    assert answer.code == 0, answer.err
    assert "nominal    autospectra" in answer.out
    assert "Repaired twin lies off by" in (tmp_path / "both.html").read_text(encoding="utf-8")
    accounts = {topic.topic: topic.samples for topic in verify_log(tmp_path / "both.mcap").topics}
    assert accounts["/nominal/yoke.force"] == accounts["/predicted/yoke.force"] == 25_600
    with LogReader(tmp_path / "plain.mcap") as plain, LogReader(tmp_path / "both.mcap") as both:
        assert not plain.channels("nominal")
        assert list(both.channels("nominal")) == list(both.channels("predicted"))
        for name, row in plain.table("predicted").items():
            assert np.array_equal(both.series("nominal", name).values, row.values)
        force = "contact.force_upper"
        assert not np.array_equal(
            both.series("predicted", force).values, both.series("nominal", force).values
        )


def test_a_run_that_a_crash_cut_short_is_overlaid_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "whole.mcap", seconds=2.0, origins=["measured"], scenario=RUN)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    overlay_run(cut, tmp_path / "overlay.mcap")
    report = verify_log(tmp_path / "overlay.mcap")
    assert (report.sound, report.recovered_from, report.size_bytes) == (True, CUT, cut.stat().st_size)
    with LogReader(tmp_path / "overlay.mcap") as log:
        assert log.complete
        measured, predicted = log.table("measured"), log.table("predicted")
    ends = {row.end_sample for row in measured.values()}
    assert 51_200 < max(ends) < 2 * 51_200
    assert max(row.end_sample for row in predicted.values()) >= max(ends) - 5120


@pytest.mark.parametrize("place", [3, 200], ids=["length", "content"])
def test_a_damaged_run_is_recovered_first(tmp_path: Path, place: int) -> None:
    """Else what was lost would stand in no ledger, in a log that looks whole."""
    run = write_log(tmp_path / "run.mcap", seconds=2.0, origins=["measured"], scenario=RUN)
    with run.open("rb") as file:
        chunk = read_summary(file.fileno()).chunks[2]
    damaged = bytearray(run.read_bytes()[: run.stat().st_size * 3 // 4])
    damaged[chunk.start + place] ^= 1
    run.write_bytes(damaged)
    with pytest.raises(LogError, match=r"is damaged \(.*\): rattle recover first"):
        overlay_run(run, tmp_path / "overlay.mcap")
    assert not (tmp_path / "overlay.mcap").exists()


def test_what_nobody_could_check_stays_unverified(tmp_path: Path) -> None:
    run = write_log(tmp_path / "run.mcap", seconds=2.0, origins=["measured"], scenario=RUN)
    overlay_run(copied_by_others(run, tmp_path / "others.mcap"), tmp_path / "overlay.mcap")
    assert verify_log(tmp_path / "overlay.mcap").unverified


def test_a_run_is_never_changed_nor_a_file_overwritten(call: Call, tmp_path: Path) -> None:
    run = write_log(tmp_path / "run.mcap", origins=["measured"], scenario=RUN)
    before = digest(run)
    assert call("overlay", run, "-o", run).code == 1
    assert digest(run) == before
