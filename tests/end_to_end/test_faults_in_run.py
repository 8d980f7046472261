"""A device, a disk or a process of ours fails while the rig moves: safe state, closed log, honest words."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from daq.block import NS_PER_S
from daq.log.reader import LogReader
from daq.log.recover import verify_log
from tests.accounting import disk_failed
from tests.conftest import RESOURCE_TRACKER
from tests.end_to_end.command import Command, Ended, await_gone, await_true, command
from tests.end_to_end.conftest import SpiedBench
from tests.end_to_end.files import CHANNELS, write_scenario

Freeze = Callable[[int], None]


def failed_run(run: Command, bench: SpiedBench) -> Ended:
    """The end of a run that has to fail: exit 1, drive off, nobody left."""
    children = run.children()
    ended = run.end()
    assert ended.code == 1, ended.err
    bench.spy.await_off()
    await_gone(children)
    return ended


def assert_readable(log: Path, complete: bool = True) -> None:
    with LogReader(log) as reader:
        assert reader.complete == complete
        assert tuple(reader.channels("measured")) == CHANNELS
        assert len(list(reader.blocks("measured"))) > 0


LOST_S = {"killed": 1.0, "frozen": 1.0}
"""By when a card is known to be gone; of one that hangs, its driver's own deadline (0.7 s) has to pass."""
SAFE_S = 0.2
_LITTLE = 64 << 20


def kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


def end_card(how: str, pid: int, freeze: Freeze) -> None:
    (freeze if how == "frozen" else kill)(pid)


@pytest.mark.parametrize("how", ["killed", pytest.param("frozen", marks=pytest.mark.long)])
def test_a_card_that_is_lost_ends_the_run(
    mortal_bench: SpiedBench, tmp_path: Path, freeze: Freeze, how: str
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=30.0)
    with command("run", scenario, "--bench", mortal_bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        mortal_bench.spy.await_on()
        lost_ns = time.time_ns()
        end_card(how, mortal_bench.card.pid, freeze)
        ended = failed_run(run, mortal_bench)
    heard = zip(mortal_bench.spy.heard_ns, mortal_bench.spy.heard, strict=True)
    off_ns = next(at_ns for at_ns, settings in heard if at_ns > lost_ns and not settings.on)
    assert (off_ns - lost_ns) / NS_PER_S < LOST_S[how] + SAFE_S
    assert mortal_bench.card.address in ended.err
    assert "reading samples" in ended.err
    assert "Check " in ended.err
    with LogReader(ended.log) as log:
        assert log.complete


@pytest.mark.long
def test_a_generator_that_falls_silent_in_the_ramp_ends_the_run(
    bench: SpiedBench, tmp_path: Path, freeze: Freeze
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", duration_s=30.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        bench.spy.await_on()
        freeze(bench.generator.pid)
        ended = run.end()
    assert ended.code == 1
    assert f"signal generator at {bench.generator.address}: no answer" in ended.err
    assert "Check that it is switched on" in ended.err
    assert "THE DRIVE MAY STILL BE ON" in ended.out
    # What it was told last is to go off; it does so as soon as it can, and then nobody tells it any more.
    goes_on = ended.goes_on
    os.kill(bench.generator.pid, signal.SIGCONT)
    bench.spy.await_off()
    await_gone([goes_on])
    with LogReader(ended.log) as log:
        assert log.complete


@pytest.mark.long
def test_a_generator_that_falls_silent_while_it_is_armed_moves_nothing(
    bench: SpiedBench, tmp_path: Path, freeze: Freeze
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml")
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("drive ")
        freeze(bench.generator.pid)
        ended = run.end()
    assert ended.code == 1
    assert f"signal generator at {bench.generator.address}: no answer" in ended.err
    goes_on = ended.goes_on  # it may have been armed; one that is gone before it answers would keep this
    os.kill(bench.generator.pid, signal.SIGCONT)
    await_gone([goes_on])
    assert not bench.spy.moved


def test_an_abort_limit_stops_the_rig(bench: SpiedBench, tmp_path: Path) -> None:
    limits = '[limits."contact.force_upper"]\nabort = "8 N"'
    scenario = write_scenario(tmp_path / "scenario.toml", duration_s=30.0, limits=limits)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        bench.spy.await_on()
        children = run.children()
        ended = run.end()
    assert ended.code == 3
    assert "interlock: contact.force_upper" in ended.err
    assert "limit 8 N" in ended.err
    bench.spy.await_off()
    await_gone(children)
    with LogReader(ended.log) as log:
        assert log.complete
        assert "limit.abort" in [event.code for event in log.events()]


def test_a_generator_that_dies_while_recording_ends_the_run(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=0.5)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        kill(bench.generator.pid)
        ended = run.end()
    assert ended.code == 1
    assert f"signal generator at {bench.generator.address}: the connection is lost" in ended.err
    assert_readable(ended.log)
    goes_on = ended.goes_on
    goes_on.terminate()  # as by hand: this generator never comes back
    await_gone([goes_on])


def helper_processes(run: Command) -> list[psutil.Process]:
    """The run's own processes in the order of their start: the supervisor, what derives, the twin."""
    ours = [child for child in run.children() if RESOURCE_TRACKER not in " ".join(child.cmdline())]
    return sorted(ours, key=lambda child: child.create_time())


@pytest.mark.long
def test_a_twin_that_dies_costs_the_prediction_and_no_measured_sample(
    bench: SpiedBench, tmp_path: Path
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=1.5)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        *_, twin = helper_processes(run)
        twin.kill()
        ended = failed_run(run, bench)
    assert "the twin's process died; all that was measured is in the log" in ended.err
    with LogReader(ended.log) as log:
        ends = {name: log.series("measured", name).end_sample for name in CHANNELS}
        assert set(ends.values()) == {round(1.5 * 51_200)}
        assert "twin.failed" in [event.code for event in log.events()]
    assert verify_log(ended.log).sound


@pytest.mark.long
def test_a_derivation_that_dies_is_told_and_costs_nothing_else(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=1.5)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        _, derivation, _ = helper_processes(run)
        derivation.kill()
        ended = run.end()
    assert ended.code == 0
    with LogReader(ended.log) as log:
        for origin in ("measured", "predicted"):
            ends = {name: log.series(origin, name).end_sample for name in CHANNELS}
            assert set(ends.values()) == {round(1.5 * 51_200)}
        assert "derived.stopped" in [event.code for event in log.events()]
    assert verify_log(ended.log).sound


def test_a_run_without_its_supervisor_stops(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=30.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        bench.spy.await_on()
        supervisor, *_ = helper_processes(run)
        supervisor.kill()
        ended = failed_run(run, bench)
    assert "the supervisor is gone" in ended.err
    with LogReader(ended.log) as log:
        assert log.complete


def test_a_disk_that_takes_no_more_stops_the_rig(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=30.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("settling")
        psutil.Process(run.pid).rlimit(psutil.RLIMIT_FSIZE, (1_500_000, 1_500_000))
        ended = failed_run(run, bench)
    assert "readable up to here" in ended.err
    assert "File too large" in ended.err
    assert_readable(disk_failed(ended.log), complete=False)


@pytest.mark.long
def test_a_run_that_gets_no_more_memory_records_to_its_end(bench: SpiedBench, tmp_path: Path) -> None:
    """But for a little: what it needs while it records it has by then. Its report may want more."""
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=3.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        process = psutil.Process(run.pid)
        most = process.memory_info().vms + _LITTLE
        process.rlimit(psutil.RLIMIT_AS, (most, most))
        await_true("its end", lambda: run.ended)
    bench.spy.await_off()
    (log,) = tmp_path.glob("*.mcap")
    assert verify_log(log).sound
    with LogReader(log) as reader:
        assert [event.code for event in reader.events()].count("record.end") == 1
        assert reader.series("measured", "drive.force").end_sample == 3 * 51_200


@pytest.mark.long
def test_a_viewer_that_dies_is_not_noticed(bench: SpiedBench, tmp_path: Path) -> None:
    """And, for the bench is all real: the log is laid out as on an emulated one."""
    limits = '[limits."drive.force"]\nwarning = "5 N"'  # of which the run takes note, and goes on
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=1.0, limits=limits)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path, "--live") as run:
        run.await_line("recording")
        [server] = [child for child in run.children() if "--serve-web" in child.cmdline()]
        view = server.parent()
        assert view is not None
        assert view.ppid() == run.pid
        for viewer in (view, server):
            viewer.kill()
        ended = run.end()
    assert ended.code == 0, ended.err
    bench.spy.await_off()
    assert verify_log(ended.log).sound
    with LogReader(ended.log) as log:
        assert tuple(log.channels("measured")) == tuple(log.channels("predicted")) == CHANNELS
        for origin, block in ((o, log.series(o, "drive.force")) for o in ("measured", "predicted")):
            assert block.end_sample == 51_200, origin
        assert "emulated" not in log.metadata["run"]
        assert [event.code for event in log.events()].count("limit.warning") == 1
