"""What instruments tell goes into the log at the run's time, whatever happens to the wall clock."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from daq.clock import SystemClock
from daq.errors import RecorderFailed
from daq.log.reader import LogReader
from daq.log.records import ClockRecord
from daq.log.writer import LogWriter
from daq.recorder import Recorder
from daq.time_base.run_clock import RunClock
from drivers.protocols.instrument import Notice
from rig.session.logbook import Logbook, logged_by, new_log
from rig.session.motor import Motor
from rig.stream import Stream
from tests.rig.session.fakes import silent_screen
from tests.rig.session.shafts import FakeDrive, SteppedClock


class SetClock(SteppedClock):
    """A host whose wall clock somebody sets."""

    set_by_s = 0.0

    def unix_ns(self) -> int:
        return super().unix_ns() + round(self.set_by_s * 1e9)


@pytest.mark.parametrize("step_s", [-3600.0, 0.0, 3600.0])
def test_a_trip_is_logged_when_it_was_although_the_wall_clock_was_set(tmp_path: Path, step_s: float) -> None:
    host = SetClock()
    clock, drive, log = RunClock(host), FakeDrive(host), tmp_path / "log.mcap"
    motor = Motor(drive, 20.0, host.sleep, drive.shaft_rpm, host)
    with Recorder(LogWriter(log), clock) as recorder:
        logbook = Logbook(clock, Stream([logged_by(recorder)]), silent_screen())
        logbook.events.append(lambda: logbook.stamped("inverter", motor.take_notices()))
        began_ns = clock.unix_ns()
        with logbook:
            host.set_by_s = step_s
            host.sleep(2.0)
            drive.notices.append(Notice(host.now_s, "error", "inverter.E.OC1", "it has tripped: E.OC1"))
            host.sleep(0.5)
    with LogReader(log) as reader:
        (trip,) = [event for event in reader.events() if event.source == "inverter"]
    assert trip.time_ns - began_ns == 2_000_000_000
    assert (trip.level, trip.code, trip.text) == ("error", "inverter.E.OC1", "it has tripped: E.OC1")


def test_the_folder_of_a_log_is_on_the_disk_before_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(descriptor: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", failing)
    with pytest.raises(RecorderFailed, match=r"^cannot make .*/lab/runs: Input/output error$"):
        new_log(tmp_path / "lab" / "runs", "beam", SteppedClock())


@contextmanager
def kept(path: Path, *clocks: Callable[[bool], list[ClockRecord]]) -> Iterator[Logbook]:
    """A logbook that tells of these clocks, into a log."""
    clock = RunClock(SystemClock())
    with Recorder(LogWriter(path), clock) as recorder:
        logbook = Logbook(clock, Stream([logged_by(recorder)]), silent_screen())
        logbook.clocks += clocks
        with logbook:
            yield logbook


def test_who_looks_waits_for_no_fit(tmp_path: Path) -> None:
    """A sequence that waited for it would be taken for dead, and its run would end."""
    begun, go_on, let_go = threading.Event(), threading.Event(), list[bool]()

    def fitting(at_last: bool) -> list[ClockRecord]:
        begun.set()
        let_go.append(go_on.wait(10.0))
        return []

    with kept(tmp_path / "log.mcap", fitting) as logbook:
        assert begun.wait(10.0)
        logbook.look()
        go_on.set()
    assert all(let_go)


@pytest.mark.parametrize("at_its_end", [False, True])
def test_a_fit_that_fails_ends_no_run_and_no_other_clock(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], at_its_end: bool
) -> None:
    told = threading.Event()

    def failing(at_last: bool) -> list[ClockRecord]:
        if at_last == at_its_end:
            raise ValueError("no line through it")
        return []

    def other(at_last: bool) -> list[ClockRecord]:
        told.set()
        return [ClockRecord(0, "other", 0.0, 0.0, 0.0)] if at_last else []

    path = tmp_path / "log.mcap"
    with kept(path, failing, other) as logbook:
        assert told.wait(10.0)
        logbook.look()
    with LogReader(path) as log:
        (event,) = log.events()
        assert [clock.device for clock in log.clocks()] == ["other"]
    assert event.code == "clock.not_fitted"
    assert event.text == "how a clock lies is told no more: ValueError: no line through it"
    assert "ValueError: no line through it" in capsys.readouterr().err


def test_a_log_that_fails_while_clocks_are_told_ends_the_run(tmp_path: Path) -> None:
    failed = threading.Event()

    def fitting(at_last: bool) -> list[ClockRecord]:
        if at_last:
            return []
        failed.set()
        raise RecorderFailed("the disk is slower than the data")

    with kept(tmp_path / "log.mcap", fitting) as logbook:
        assert failed.wait(10.0)
        logbook._thread.join(10.0)
        with pytest.raises(RecorderFailed, match="slower than the data"):
            logbook.look()
