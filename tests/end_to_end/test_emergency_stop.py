"""An emergency stop ends a run, whoever still lives, and the next one wants the line healthy and a person."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from daq.block import NS_PER_S
from daq.log.reader import LogReader
from daq.log.records import STOPPING
from tests.end_to_end.command import ROOT, await_true, command, rattle
from tests.end_to_end.files import write_bench, write_scenario
from tests.end_to_end.spied_bench import DriveSpy, light_card, spied_generator
from tests.end_to_end.spied_crank import spied_crank

LINE = "cDAQ1Mod4/port0/line0"
IN_TIME_S = 0.3
"""Half of it is what a busy machine may add; see tests/drivers for the time itself."""


@dataclass(frozen=True, slots=True)
class StoppedBench:
    file: Path
    spy: DriveSpy
    _rehearsal: Connection

    def press(self) -> float:
        """Open the line; when that was, Unix epoch."""
        self._rehearsal.send({LINE: False})
        return time.time()

    def free(self) -> None:
        self._rehearsal.send({LINE: True})


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[StoppedBench]:
    rehearsal, ordered = get_context("spawn").Pipe()
    with (
        light_card(lines={LINE: True}, rehearsal=ordered) as (card, onward),
        spied_generator(onward) as (generator, spy),
    ):
        ordered.close()
        table = f'[emergency_stop]\nline = "{LINE}"'
        file = write_bench(tmp_path / "bench.toml", generator.address, card.address, table)
        yield StoppedBench(file, spy, rehearsal)
    rehearsal.close()


def stopping_s(log: Path) -> float:
    """When a run was stopped by it, as its log says."""
    with LogReader(log) as reader:
        assert reader.complete
        told = {event.code: event for event in reader.events()}
    assert "(emergency stop at" in told[STOPPING].text
    assert told[STOPPING].time_ns == told["emergency_stop"].time_ns
    return told[STOPPING].time_ns / NS_PER_S


def at_terminal(*arguments: object) -> tuple[int, str]:
    """Exit code and output of a command whose person presses Enter, again and again."""
    ours, theirs = pty.openpty()
    with (
        open(ours, "wb", buffering=0) as typed,
        subprocess.Popen(  # noqa: S603
            [sys.executable, "-m", "rig.start", *map(str, arguments)],
            cwd=ROOT,
            stdin=theirs,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        ) as person,
    ):
        os.close(theirs)
        while person.poll() is None:
            typed.write(b"\n")
            time.sleep(0.2)
        return person.returncode, person.communicate()[0]


def test_it_ends_the_run_and_the_next_wants_the_line_and_a_person(
    bench: StoppedBench, tmp_path: Path
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=30.0)
    arguments = "run", scenario, "--bench", bench.file, "--out", tmp_path
    with command(*arguments) as run:
        run.await_line("recording")
        bench.spy.await_on()
        pressed_s = bench.press()
        await_true("drive off", lambda: not bench.spy.on)
        assert time.time() - pressed_s < IN_TIME_S
        ended = run.end()
    assert ended.code == 3, ended.err
    assert f"emergency stop at {LINE} of " in ended.err
    assert "its line is open. Check that nobody is in danger, free it where it was pressed" in ended.err
    assert 0.0 <= stopping_s(ended.log) - pressed_s < IN_TIME_S
    moved = len(bench.spy.heard)
    refused = rattle(*arguments)
    assert refused.code == 3
    assert "its line is open" in refused.err
    bench.free()
    # what is latched is the generator, for whoever comes to it by whatever bench file
    other = tmp_path / "other.toml"
    other.write_text(bench.file.read_text().partition("[emergency_stop]")[0])
    unconfirmed = rattle("run", scenario, "--bench", other, "--out", tmp_path, typed="\n")
    assert unconfirmed.code == 1
    assert "nobody is there to confirm" in unconfirmed.err
    assert not any(settings.on for settings in bench.spy.heard[moved:])
    short = write_scenario(tmp_path / "short.toml", settle_s=0.1, duration_s=0.2)
    code, out = at_terminal("run", short, *arguments[2:])
    assert code == 0, out
    assert "ended a run: its line is open. Enter once nobody is in danger" in " ".join(out.split())


def test_a_frozen_run_is_switched_off_by_the_supervisor_as_soon(
    bench: StoppedBench, tmp_path: Path, freeze: Callable[[int], None]
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=30.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        bench.spy.await_on()
        freeze(run.pid)
        pressed_s = bench.press()
        await_true("drive off", lambda: not bench.spy.on)
        assert time.time() - pressed_s < IN_TIME_S
        os.kill(run.pid, signal.SIGCONT)
        ended = run.end()
    assert ended.code == 3, ended.err
    assert 0.0 <= stopping_s(ended.log) - pressed_s < IN_TIME_S


@pytest.mark.long
def test_one_on_the_inverter_stops_the_motor(tmp_path: Path) -> None:
    with (
        spied_crank(tmp_path, stop="inverter/RH") as crank,
        command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run,
    ):
        run.await_line("recording")
        pressed_s, monotonic_s = time.time(), time.monotonic()
        crank.press()
        crank.spy.await_stopping()
        ended = run.end()
        assert ended.code == 3, ended.err
        assert "emergency stop at inverter/RH of socket://" in ended.err
        assert crank.spy.heard[-1].target == 0.0
        assert crank.spy.heard[-1].started_s - monotonic_s < IN_TIME_S
        assert 0.0 <= stopping_s(ended.log) - pressed_s < IN_TIME_S


@pytest.mark.long
def test_one_on_the_ramp_of_another_error_is_what_the_run_ends_by(tmp_path: Path) -> None:
    with (
        spied_crank(tmp_path, stop="inverter/RH") as crank,
        command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run,
    ):
        run.await_line("recording")
        os.kill(crank.encoder.pid, signal.SIGKILL)
        crank.spy.await_stopping()
        crank.press()
        ended = run.end()
    assert ended.code == 3, ended.err
    assert "emergency stop at inverter/RH of socket://" in ended.err
    with LogReader(ended.log) as reader:
        assert "the encoder was lost" in {gap.cause for gap in reader.gaps()}
