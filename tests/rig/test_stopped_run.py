"""A run that was stopped before its time: its way to rest is in the log, and in no figure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.block import NS_PER_S
from daq.clock import SystemClock
from daq.log.reader import LogReader
from daq.log.records import STOPPING, Event
from daq.log.writer import LogWriter
from rig.diagnosis.recordings import recorded
from rig.report.page import render
from rig.report.record import RunCollector, RunRecord, read_run
from rig.session.overlay import overlay_run
from rig.session.progress import Screen, Terminal
from rig.session.replay import replay_log
from tests.rig.synthetic_run import CHANNELS, RATE, SCENARIO, START_NS, blocks, write_log

STEADY_S, RECORDED_S = 2.05, 3.0
"""The stop lies within a block."""
RUN = f'{SCENARIO}\n[acquisition]\nsample_rate = "51.2 kHz"\nduration = "3 s"\n'


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The synthetic run, of which nothing is left but an offset once it is stopped."""
    path = tmp_path_factory.mktemp("stopped") / "stopped.mcap"
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": RUN})
        for channel in CHANNELS:
            log.declare("measured", channel)
        for block in blocks(CHANNELS, "measured", RECORDED_S):
            rests = np.arange(block.first_sample, block.end_sample) >= STEADY_S * RATE
            values = np.where(rests, np.float32(5.0), block.values)
            log.add_block("measured", replace(block, values=values), block.time_ns)
        stopped_ns = START_NS + round(STEADY_S * NS_PER_S)
        log.add_event(Event(stopped_ns, "warning", "rig", STOPPING, "stopping before its time"))
    return path


@pytest.fixture(scope="module")
def steady(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same without what came then."""
    folder = tmp_path_factory.mktemp("steady")
    return write_log(folder / "steady.mcap", STEADY_S, origins=["measured"], scenario=RUN)


def rms(run: RunRecord) -> dict[str, float]:
    return {name: tally.rms for name, tally in run.measured.items()}


def test_its_report_is_of_what_went_as_it_was_meant_to(stopped: Path, steady: Path) -> None:
    run = read_run(stopped)
    assert run.until_stop_s == pytest.approx(STEADY_S)
    assert run.duration_s == pytest.approx(STEADY_S)
    assert rms(run) == rms(read_run(steady))
    assert "Stopped before its time, after 2.05 s" in render(run)
    assert read_run(steady).until_stop_s is None


def test_its_replay_compares_the_same(stopped: Path, steady: Path) -> None:
    with LogReader(stopped) as log:
        assert log.stopped_ns is not None
        collector = RunCollector(log)
        replay_log(stopped, 0.0, None, Screen(Terminal(quiet=True)), SystemClock(), (collector,))
        assert rms(collector.record()) == rms(read_run(steady))
        assert max(each.time_ns for each in collector.record().impacts) < log.stopped_ns


def test_no_twin_follows_it_to_rest(stopped: Path, tmp_path: Path) -> None:
    overlay_run(stopped, tmp_path / "overlay.mcap")
    with LogReader(tmp_path / "overlay.mcap") as log:
        assert log.until_stop_s == pytest.approx(STEADY_S)
        assert log.series("predicted", "drive.force").end_sample == round(STEADY_S * RATE)
        assert log.series("measured", "drive.force").end_sample == round(RECORDED_S * RATE)


def test_a_diagnosis_is_of_what_went_as_it_was_meant_to(stopped: Path, steady: Path) -> None:
    whole, cut = recorded([steady]), recorded([stopped])
    assert np.array_equal(whole.measured, cut.measured)
    assert "stopped before its time, after 2.05 s; the rest is not used" in " ".join(cut.remarks)
