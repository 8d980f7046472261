"""However a run is stopped, the drive goes off, the log is closed, and no process stays."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import psutil
import pytest

from daq.log.reader import LogReader
from daq.log.recover import recover_log
from tests.end_to_end.command import Command, await_gone, await_true, command
from tests.end_to_end.conftest import SpiedBench
from tests.end_to_end.files import CHANNELS, write_scenario

# Drive off at once; then a last block of the card (0.1 s), the end of the twin (1 s) and of the supervisor.
STOPPED_WITHIN_S = 6.0


def stop_at(moment: str, run: Command, bench: SpiedBench) -> None:
    if moment == "ramp down":
        bench.spy.await_ramp_down()
    else:
        run.await_line(moment)
        bench.spy.await_on()


@pytest.mark.parametrize(
    ("moment", "number", "times"),
    [
        pytest.param("settling", signal.SIGINT, 1, marks=pytest.mark.long),
        ("recording", signal.SIGINT, 10),
        ("ramp down", signal.SIGINT, 3),
        pytest.param("recording", signal.SIGTERM, 1, marks=pytest.mark.long),
        pytest.param("recording", signal.SIGHUP, 1, marks=pytest.mark.long),
        pytest.param("recording", signal.SIGQUIT, 1, marks=pytest.mark.long),
    ],
)
def test_a_stop_leaves_the_rig_safe_and_the_log_closed(
    bench: SpiedBench, tmp_path: Path, moment: str, number: signal.Signals, times: int
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", duration_s=0.4 if moment == "ramp down" else 30.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        stop_at(moment, run, bench)
        children = run.children()
        asked_s = time.monotonic()
        for _ in range(times):
            run.signal(number)
        ended = run.end(STOPPED_WITHIN_S + 10)
    assert ended.code == 130
    assert time.monotonic() - asked_s < STOPPED_WITHIN_S
    assert ended.err.strip().splitlines()[-1] == "rattle: stopped by a person; the drive is off"
    if moment == "recording":  # said at once, while it comes to rest
        assert "! stopping before its time (stopped by a person)" in ended.out
    bench.spy.await_off()
    await_gone(children)
    with LogReader(ended.log) as log:
        assert log.complete
        assert tuple(log.channels("measured")) == CHANNELS
        assert "run.interrupted" in [event.code for event in log.events()]


@pytest.mark.long
def test_a_stop_while_a_derivation_that_hangs_is_waited_for_ends_the_wait(
    bench: SpiedBench, tmp_path: Path
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", duration_s=0.4)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        children = run.children()
        workers = sorted(filter(is_worker, children), key=lambda each: each.pid)
        derivation, twin = workers[-2:]  # as they are started
        derivation.suspend()
        await_true("the prediction is finished", lambda: has_ended(twin))
        time.sleep(0.5)
        asked_s = time.monotonic()
        run.signal(signal.SIGINT)
        ended = run.end()
    assert ended.code == 130
    assert time.monotonic() - asked_s < STOPPED_WITHIN_S
    await_gone(children)
    with LogReader(ended.log) as log:
        assert log.complete
        assert "derived.stopped" in [event.code for event in log.events()]


def is_worker(process: psutil.Process) -> bool:
    return any("spawn_main" in part for part in process.cmdline())


def has_ended(process: psutil.Process) -> bool:
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


def test_a_stop_while_instruments_connect_moves_nothing(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml")
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("connecting")
        run.signal(signal.SIGINT)
        ended = run.end()
    assert ended.code == 130
    assert not bench.spy.moved
    assert not list(tmp_path.glob("*.mcap"))


def test_a_killed_run_is_switched_off_by_its_supervisor(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=30.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        bench.spy.await_on()
        children = run.children()
        (log,) = tmp_path.glob("*.mcap")
        await_true("half a second in the log", lambda: log.stat().st_size > 150_000)
        psutil.Process(run.pid).kill()
        run.end()
        bench.spy.await_off()
        await_gone(children)
    report = recover_log(log, tmp_path / "recovered.mcap")
    assert report.sound
    assert {topic.samples > 0 for topic in report.topics if topic.topic.startswith("/measured/")} == {True}
