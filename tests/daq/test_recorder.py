"""The recorder keeps everything or says that it could not; the first failed write is the last."""

from __future__ import annotations

import errno
import threading
import time
from pathlib import Path
from typing import IO

import pytest

from daq import recorder as recorder_module
from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import RecorderFailed
from daq.log.reader import LogReader
from daq.log.records import Event
from daq.log.recover import recover_log, verify_log
from daq.log.writer import LogWriter
from daq.recorder import Recorder
from tests.daq.log.logs import BLOCK, START_NS, block


class FullDisk:
    """A file on a disk that takes `most` writes."""

    def __init__(self, file: IO[bytes], most: int) -> None:
        self._file, self.most = file, most

    def write(self, data: bytes) -> int:
        self.most -= 1
        if self.most < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._file.write(data)

    def __getattr__(self, name: str) -> object:
        return getattr(self._file, name)


class WriterOnFullDisk(LogWriter):
    """Fails at its n-th write to the file."""

    def __init__(self, path: Path, most: int) -> None:
        super().__init__(path)
        self._most = most

    def open(self) -> LogWriter:
        super().open()
        self._file = FullDisk(self._file, self._most)  # type: ignore[assignment]
        self._writer._Writer__stream = self._file
        return self


class StuckWriter(LogWriter):
    """Writes nothing until it is let go."""

    def __init__(self, path: Path, go: threading.Event) -> None:
        super().__init__(path)
        self._go = go

    def add_event(self, event: Event) -> None:
        self._go.wait()
        super().add_event(event)


def record_ramp(recorder: Recorder, blocks: int, begin: int = 0) -> None:
    recorder.declare("measured", Channel("a", "N"))
    for number in range(begin, begin + blocks):
        recorder.block("measured", block(number))


def test_everything_handed_over_is_in_the_log(tmp_path: Path) -> None:
    with Recorder(LogWriter(tmp_path / "log.mcap"), SystemClock()) as recorder:
        recorder.metadata("scenario", {"toml": "x = 1"})
        record_ramp(recorder, 50)
        recorder.event(Event(START_NS, "info", "rig", "record.end", "done"))
    assert verify_log(tmp_path / "log.mcap").sound
    with LogReader(tmp_path / "log.mcap") as log:
        assert log.series("measured", "a").end_sample == 50 * BLOCK
        assert [event.code for event in log.events()] == ["record.end"]
    assert recorder.blocks == 50


def test_the_first_failed_write_is_the_last_at_any_place(tmp_path: Path) -> None:
    """A disk that fails at write 1, 2, 3 ... until none fails: always one error and a readable prefix."""
    for most in range(100):
        path = tmp_path / f"{most}.mcap"
        failure = failure_of_a_log(path, most)
        if failure is None:
            break
        assert "No space left on device" in failure
        if most > 1:
            with LogReader(recovered(path)) as log:
                ends = [each.end_sample for _, each in log.blocks()]
            assert ends == sorted(ends)
    assert 5 < most < 99


def failure_of_a_log(path: Path, most: int) -> str | None:
    try:
        with WriterOnFullDisk(path, most) as writer:
            write_until_it_fails(writer)
    except RecorderFailed as error:
        return str(error)
    return None


def recovered(path: Path) -> Path:
    target = path.with_suffix(".recovered.mcap")
    assert recover_log(path, target).sound
    return target


def write_until_it_fails(writer: LogWriter) -> None:
    """After the first failure nothing more is accepted."""
    writer.add_metadata("scenario", {"toml": "x = 1"})
    writer.declare("measured", Channel("a", "N"))
    for number in range(12):
        try:
            writer.add_block("measured", block(number), START_NS + number * 10**8)
        except RecorderFailed:
            with pytest.raises(RecorderFailed, match=r"stopped after .*No space left"):
                writer.add_block("measured", block(number + 1), START_NS + number * 10**8)
            raise


def test_a_full_disk_stops_the_caller_and_says_so_at_the_end(tmp_path: Path) -> None:
    recorder = Recorder(WriterOnFullDisk(tmp_path / "log.mcap", 4), SystemClock())
    recorder.__enter__()
    with pytest.raises(RecorderFailed, match=r"No space left on device; the log is readable up to here"):
        hand_over_until_it_fails(recorder)
    with pytest.raises(RecorderFailed, match="No space left on device"):
        recorder.close()


def hand_over_until_it_fails(recorder: Recorder) -> None:
    """At the pace of data: a writer that gets no turn would be a slow disk, not a full one."""
    while True:
        time.sleep(1e-3)
        record_ramp(recorder, 1, begin=recorder.blocks)
        recorder.event(Event(START_NS + recorder.blocks * 10**9, "info", "rig", "x", "y"))


def test_a_queue_that_runs_full_is_an_error_not_a_loss(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "_QUEUE_ITEMS", 10)
    go = threading.Event()
    event = Event(START_NS, "info", "rig", "x", "y")
    with Recorder(StuckWriter(tmp_path / "log.mcap", go), SystemClock()) as recorder:
        recorder.event(event)
        while recorder._queue.qsize():  # the writer's thread has it and sticks
            SystemClock().sleep(0.001)
        for _ in range(10):
            recorder.event(event)
        with pytest.raises(RecorderFailed, match="the disk is slower than the data"):
            recorder.event(event)
        assert recorder.high_water == 10
        go.set()
    with LogReader(tmp_path / "log.mcap") as log:
        assert len(log.events()) == 11


def test_a_fault_of_ours_while_writing_is_reported_as_a_lost_log(tmp_path: Path) -> None:
    recorder = Recorder(LogWriter(tmp_path / "log.mcap"), SystemClock())
    recorder.__enter__()
    recorder.block("measured", block(0))
    with pytest.raises(RecorderFailed, match="KeyError"):
        recorder.close()


def test_a_slow_stream_is_in_the_file_while_the_run_goes_on(tmp_path: Path) -> None:
    """Without another block: the recorder's own idling ends the chunk."""
    path = tmp_path / "log.mcap"
    clock = SystemClock()
    with Recorder(LogWriter(path), clock) as recorder:
        recorder.event(Event(clock.unix_ns(), "info", "rig", "x", "the only one"))
        deadline = clock.monotonic_s() + 10
        while b"/event" not in path.read_bytes() and not events_of(path):
            assert clock.monotonic_s() < deadline
            clock.sleep(0.01)
        assert events_of(path) == ["the only one"]


def events_of(path: Path) -> list[str]:
    try:
        with LogReader(path) as log:
            return [event.text for event in log.events()]
    except ValueError:
        return []
