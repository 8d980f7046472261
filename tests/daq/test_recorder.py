"""The recorder keeps everything or says that it could not; the first failed write is the last."""

from __future__ import annotations

import errno
import io
import os
import re
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import pytest

from daq import recorder as recorder_module
from daq.block import SampleBlock
from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import RecorderFailed
from daq.log import writer as writer_module
from daq.log.reader import LogReader
from daq.log.records import STOPPING, Event
from daq.log.recover import recover_log, verify_log
from daq.log.writer import LogWriter
from daq.recorder import Recorder
from tests.daq.log.logs import BLOCK, RATE, START_NS, block

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer


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


def test_nothing_comes_behind_what_a_full_queue_refused_but_what_is_missing_and_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "_QUEUE_ITEMS", 10)
    go, path = threading.Event(), tmp_path / "log.mcap"
    event = Event(START_NS, "info", "rig", "x", "y")
    recorder = Recorder(StuckWriter(path, go), SystemClock())
    recorder.__enter__()
    recorder.declare("measured", Channel("a", "N"))
    recorder.declare("measured", Channel("b", "N"))
    recorder.event(event)
    while recorder._queue.qsize():  # the writer's thread has it and sticks
        SystemClock().sleep(0.001)
    for number in range(10):
        recorder.block("measured", block(number))
    slow = "the disk is slower than the data"
    with pytest.raises(RecorderFailed, match=slow):
        recorder.block("measured", block(10))
    assert recorder.high_water == 10
    go.set()
    while recorder._queue.qsize():
        SystemClock().sleep(0.001)
    with pytest.raises(RecorderFailed, match=slow):
        recorder.block("measured", block(11))
    for name in ("a", "b"):
        with pytest.raises(RecorderFailed, match=slow):
            recorder.due("measured", name, 12 * BLOCK, "stopped")
    with pytest.raises(RecorderFailed, match=slow):
        recorder.event(Event(START_NS, "warning", "rig", STOPPING, "stopping"))
    with pytest.raises(RecorderFailed, match=f"{slow}; 2 more refused"):
        recorder.close()
    report = verify_log(path)
    assert report.sound
    with LogReader(path) as log:
        assert [each.code for each in log.events()] == ["x", STOPPING]
        gaps = {(gap.channel, gap.first_sample, gap.count): gap.cause for gap in log.gaps()}
    assert gaps.keys() == {("a", 10 * BLOCK, 2 * BLOCK), ("b", 0, 12 * BLOCK)}
    assert all(slow in cause for cause in gaps.values())


def test_a_disk_that_stalls_ten_seconds_under_64_channels_costs_nothing(tmp_path: Path) -> None:
    """Measured and predicted, each with two figures of its cycles: what comes while nothing is written."""
    go, path = threading.Event(), tmp_path / "log.mcap"
    samples, of_cycles = np.zeros(3840, np.float32), np.zeros(1, np.float32)
    with Recorder(StuckWriter(path, go), SystemClock()) as recorder:
        recorder.declare("measured", Channel("a", "N"))
        recorder.event(Event(START_NS, "info", "rig", "x", "the writer sticks"))
        first = 0
        for number in range(round(10 / 0.075) * 64 * 2 * 3):
            values = of_cycles if number % 3 else samples
            recorder.block("measured", SampleBlock("a", first, START_NS, RATE, values))
            first += len(values)
        go.set()
    assert recorder.refused == 0
    (topic,) = (each for each in verify_log(path).topics if each.topic == "/measured/a")
    assert (topic.samples, topic.missing) == (first, 0)


def test_samples_wait_for_the_disk_up_to_so_many_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "_QUEUE_BYTES", 10 * block(0).values.nbytes)
    go, path = threading.Event(), tmp_path / "log.mcap"
    go.set()
    recorder = Recorder(StuckWriter(path, go), SystemClock())
    recorder.__enter__()
    recorder.declare("measured", Channel("a", "N"))
    for number in range(30):  # what is written waits no more
        while recorder._queue.qsize():
            SystemClock().sleep(0.001)
        recorder.block("measured", block(number))
    while recorder.waiting_bytes:
        SystemClock().sleep(0.001)
    go.clear()
    recorder.event(Event(START_NS, "info", "rig", "x", "y"))
    while recorder._queue.qsize():
        SystemClock().sleep(0.001)
    for number in range(30, 40):
        recorder.block("measured", block(number))
    with pytest.raises(RecorderFailed, match="the disk is slower than the data"):
        recorder.block("measured", block(40))
    go.set()
    with pytest.raises(RecorderFailed, match="the disk is slower than the data"):
        recorder.close()


class DiskOfItsOwnPace(LogWriter):
    """Takes writes at once; what it does when it is asked to sync comes from outside."""

    def __init__(self, path: Path, syncing: Callable[[], None]) -> None:
        super().__init__(path)
        self._before_sync = syncing

    def sync(self) -> None:
        self._before_sync()
        super().sync()


def test_what_is_written_comes_to_the_disk_every_second(tmp_path: Path) -> None:
    synced: list[float] = []
    clock = SystemClock()
    begin_s = clock.monotonic_s()
    with Recorder(DiskOfItsOwnPace(tmp_path / "log.mcap", lambda: synced.append(clock.monotonic_s())), clock):
        while len(synced) < 2:
            assert clock.monotonic_s() < begin_s + 20
            clock.sleep(0.01)
    assert synced[1] - synced[0] > 0.9
    assert len(synced) >= 3  # the last as it is closed


class SlowWriter(LogWriter):
    """Takes longer for the rest than a disk may say nothing, and a tenth of that for each block."""

    def add_block(self, origin: str, block: SampleBlock, host_ns: int) -> None:
        SystemClock().sleep(0.02)
        super().add_block(origin, block, host_ns)


def test_what_waits_at_the_end_is_written_however_slow_the_disk_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "_HUNG_DISK_S", 0.2)
    with Recorder(SlowWriter(tmp_path / "log.mcap"), SystemClock()) as recorder:
        record_ramp(recorder, 40)
    (topic,) = verify_log(tmp_path / "log.mcap").topics
    assert (topic.messages, topic.missing) == (40, 0)


def test_a_disk_that_takes_nothing_more_at_the_end_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "_HUNG_DISK_S", 0.2)
    go = threading.Event()
    recorder = Recorder(StuckWriter(tmp_path / "log.mcap", go), SystemClock())
    recorder.__enter__()
    recorder.event(Event(START_NS, "info", "rig", "x", "the writer sticks"))
    with pytest.raises(RecorderFailed, match="the disk does not answer; the end of the run is lost"):
        recorder.close()
    go.set()
    recorder.close()


def test_a_disk_that_stalls_while_it_syncs_costs_nothing(tmp_path: Path) -> None:
    stalled, go = threading.Event(), threading.Event()

    def stall() -> None:
        stalled.set()
        go.wait()

    clock, path = SystemClock(), tmp_path / "log.mcap"
    with Recorder(DiskOfItsOwnPace(path, stall), clock) as recorder:
        assert stalled.wait(20)
        record_ramp(recorder, 50)
        recorder.event(Event(clock.unix_ns(), "info", "rig", "x", "after them"))
        deadline = clock.monotonic_s() + 20
        while events_of(path) != ["after them"]:
            assert clock.monotonic_s() < deadline
            clock.sleep(0.01)
        go.set()
    assert verify_log(path).sound


def test_a_folder_that_takes_the_log_alone_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(dir: Path) -> None:  # noqa: A002 - as the library has it
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr("daq.log.writer.TemporaryFile", none)
    with pytest.raises(RecorderFailed, match="Too many open files"):
        LogWriter(tmp_path / "log.mcap").open()
    assert not list(tmp_path.iterdir())


def test_a_disk_that_runs_short_stops_the_caller_while_the_log_can_be_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = shutil.disk_usage(tmp_path)
    path, words = tmp_path / "log.mcap", r"0\.50 GB free, and 1\.07 GB have to stay free; make room"
    recorder = Recorder(LogWriter(path), SystemClock())
    recorder.__enter__()
    recorder.declare("measured", Channel("a", "N"))
    monkeypatch.setattr(shutil, "disk_usage", lambda _: left._replace(free=500_000_000))
    with pytest.raises(RecorderFailed, match=words):
        hand_over_until_it_fails(recorder)
    with pytest.raises(RecorderFailed, match=words):
        recorder.due("measured", "a", recorder.blocks * BLOCK, "stopped")
    with pytest.raises(RecorderFailed, match=words):
        recorder.close()
    report = verify_log(path)
    assert report.sound
    assert report.topics[0].samples > 0
    assert report.topics[0].samples + report.ledger_missing == recorder.blocks * BLOCK
    with pytest.raises(RecorderFailed, match=words), Recorder(LogWriter(tmp_path / "2.mcap"), SystemClock()):
        pass
    assert not (tmp_path / "2.mcap").exists()


def test_a_disk_that_runs_short_is_told_a_minute_before_also_while_it_stalls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, left = SystemClock(), shutil.disk_usage(tmp_path)
    path, go, free = tmp_path / "log.mcap", threading.Event(), 2 << 30
    monkeypatch.setattr(recorder_module, "SYNC_S", 0.01)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: left._replace(free=free))
    with Recorder(DiskOfItsOwnPace(path, lambda: go.wait()), clock) as recorder:
        record_ramp(recorder, 1)
        recorder.event(Event(clock.unix_ns(), "info", "rig", "x", "ends the chunk"))
        while not path.stat().st_size:
            clock.sleep(0.01)
        clock.sleep(0.1)
        assert recorder.events() == ()
        free = (1 << 30) + 1000
        until_s = clock.monotonic_s() + 20.0
        while not (told := recorder.events()):
            assert clock.monotonic_s() < until_s
            clock.sleep(0.01)
        assert [(each.level, each.code) for each in told] == [("warning", "disk.short")]
        assert "1.07 GB free, and 1.07 GB have to stay free: the run stops within a minute" in told[0].text
        clock.sleep(0.1)
        assert recorder.events() == ()
        go.set()


@pytest.mark.parametrize("error", [RecorderFailed("no disk any more"), RuntimeError("no disk any more")])
def test_a_disk_that_fails_to_sync_stops_the_caller(tmp_path: Path, error: Exception) -> None:
    errors = [error]

    def fail() -> None:
        if errors:
            raise errors.pop()

    recorder = Recorder(DiskOfItsOwnPace(tmp_path / "log.mcap", fail), SystemClock())
    recorder.__enter__()
    with pytest.raises(RecorderFailed, match="no disk any more"):
        hand_over_until_it_fails(recorder)
    with pytest.raises(RecorderFailed, match="no disk any more"):
        recorder.close()


def test_a_fault_of_ours_while_writing_is_reported_as_a_lost_log(tmp_path: Path) -> None:
    recorder = Recorder(LogWriter(tmp_path / "log.mcap"), SystemClock())
    recorder.__enter__()
    recorder.block("measured", block(0))
    with pytest.raises(RecorderFailed, match="KeyError"):
        recorder.close()


class WriterWithoutMemory(LogWriter):
    """Gets none for its third block."""

    def add_encoded_block(self, origin: str, block: SampleBlock, *rest: Any, **options: Any) -> int:
        if block.first_sample == 2 * BLOCK:
            raise MemoryError
        return super().add_encoded_block(origin, block, *rest, **options)


def test_want_of_memory_stops_the_caller_and_leaves_what_came_before(tmp_path: Path) -> None:
    """In a log that says that it is not whole: nothing tells of the samples behind."""
    path = tmp_path / "log.mcap"
    recorder = Recorder(WriterWithoutMemory(path), SystemClock())
    recorder.__enter__()
    with pytest.raises(RecorderFailed, match="MemoryError"):
        hand_over_until_it_fails(recorder)
    with pytest.raises(RecorderFailed, match="MemoryError"):
        recorder.close()
    assert recorder.refused
    assert not verify_log(path).sound
    with LogReader(path) as log:
        assert not log.complete
        assert log.series("measured", "a").end_sample == 2 * BLOCK


def test_a_sample_that_comes_twice_leaves_the_log_unfinished(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    recorder = Recorder(LogWriter(path), SystemClock())
    recorder.__enter__()
    record_ramp(recorder, 2)
    recorder.block("measured", block(0))
    with pytest.raises(RecorderFailed, match="comes twice"):
        recorder.close()
    assert not verify_log(path).complete
    with LogReader(path) as log:
        assert log.series("measured", "a").end_sample == 2 * BLOCK


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


class FailingDisk:
    """Lets the `nth` of one kind of call to the file, its indexes or the disk fail, and counts them."""

    def __init__(self, call: str, nth: int) -> None:
        self.call, self.nth, self.count = call, nth, 0

    def __call__(self, call: str) -> None:
        self.count += call == self.call
        if call == self.call and self.count == self.nth:
            raise OSError(errno.EIO, "Input/output error")

    def put_below(self, monkeypatch: pytest.MonkeyPatch) -> None:
        opened, disk = Path.open, self

        class File(io.BufferedWriter):
            def write(self, data: Buffer) -> int:
                disk("write")
                return super().write(data)

            def flush(self) -> None:
                if not self.closed:
                    disk("flush")
                super().flush()

            def close(self) -> None:
                if not self.closed:
                    super().close()
                    disk("close")

        def open_file(path: Path, mode: str = "r", **options: Any) -> object:
            if mode != "xb":
                return opened(path, mode, **options)
            disk("open")
            return File(io.FileIO(path, "xb"))

        monkeypatch.setattr(Path, "open", open_file)
        monkeypatch.setattr("daq.log.writer.TemporaryFile", self._open_indexes)
        for call in ("fdatasync", "fsync"):  # of the file; of its folder
            real = getattr(os, call)
            monkeypatch.setattr(os, call, lambda number, call=call, real=real: (disk(call), real(number)))

    def _open_indexes(self, dir: Path) -> object:  # noqa: A002 - as the library has it
        disk = self

        class Indexes(io.BufferedRandom):
            def write(self, data: Buffer) -> int:
                disk("write of indexes")
                return super().write(data)

            def seek(self, place: int, whence: int = 0) -> int:
                disk("seek of indexes")  # writes what is left
                return super().seek(place, whence)

            def read(self, size: int | None = -1) -> bytes:
                disk("read of indexes")
                return super().read(size)

        disk("open of indexes")
        return Indexes(TemporaryFile(dir=dir, buffering=0))


@pytest.mark.parametrize(
    "call",
    [
        *("open", "write", "flush", "fdatasync", "fsync", "close"),
        *(f"{call} of indexes" for call in ("open", "write", "seek", "read")),
    ],
)
def test_whatever_call_fails_first_it_is_one_error_and_a_readable_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """The n-th, for n = 1, 2, ... until none is the n-th. Nothing renames a log.

    The indexes wait in a file without a name until the log is closed; its own closing loses nothing.
    """
    monkeypatch.setattr(recorder_module, "SYNC_S", 0.01)
    monkeypatch.setattr(writer_module, "CHUNK_S", 0.0)  # each block is a chunk
    for nth in range(1, 400):
        path = tmp_path / f"{nth}.mcap"
        with monkeypatch.context() as patch:
            disk = FailingDisk(call, nth)
            disk.put_below(patch)
            handed_over, failed = record_until_it_fails(path)
        if disk.count < nth:
            break
        assert failed, (call, nth)
        if handed_over and b"scenario" in path.read_bytes():  # its first record has come to the disk
            with LogReader(recovered(path)) as log:
                blocks = list(log.blocks())
            with LogReader(path) as log:
                assert not log.complete or len(blocks) == handed_over
            assert [each.first_sample for _, each in blocks] == [BLOCK * n for n in range(len(blocks))]
            # those of the failed call and of the one before it, and what was handed over meanwhile
            assert len(blocks) >= handed_over - 4
    assert 1 < nth < 399


@pytest.mark.parametrize("closed", [False, True], ids=["as it is written", "as it is closed"])
def test_a_disk_that_failed_to_sync_once_is_believed_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, closed: bool
) -> None:
    """What it had not written may be gone, and the next sync says nothing of it."""
    path = tmp_path / "log.mcap"
    writer = LogWriter(path).open()
    writer.declare("measured", Channel("a", "N"))
    writer.add_block("measured", block(0), START_NS)
    writer.flush_if_older(START_NS + 10**9)
    FailingDisk("fdatasync", 1).put_below(monkeypatch)
    whole = f"^{re.escape(str(path))}: \\[Errno 5\\] Input/output error; the log is readable up to here$"
    with pytest.raises(RecorderFailed, match=whole):
        (writer.close if closed else writer.sync)()
    if not closed:
        with pytest.raises(RecorderFailed, match=r"stopped after .*Input/output error"):
            writer.add_block("measured", block(1), START_NS)
    writer.close()
    with LogReader(path) as log:
        assert not log.complete
        assert log.series("measured", "a").end_sample == BLOCK


@pytest.mark.parametrize("by_whom", ["itself", "a run"])
def test_a_failure_that_closing_told_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by_whom: str
) -> None:
    """Of what was still waiting, such as at the end of a run: nothing is handed over after it."""
    recorder = Recorder(LogWriter(tmp_path / "log.mcap"), SystemClock())

    def fails(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    def record() -> None:
        with recorder:
            recorder.declare("measured", Channel("a", "N"))
            monkeypatch.setattr(LogWriter, "add_block", fails)
            recorder.block("measured", block(0))
            if by_whom == "a run":
                recorder.close()

    with pytest.raises(RecorderFailed, match="Input/output error") as ending:
        record()
    assert str(ending.value).count("Input/output error") == 1
    assert not hasattr(ending.value, "__notes__")


def record_until_it_fails(path: Path) -> tuple[int, list[str]]:
    """How many blocks were taken, and every error that was raised."""
    taken, failed = 0, list[str]()
    recorder = Recorder(LogWriter(path), SystemClock())
    try:
        with recorder:
            recorder.metadata("scenario", {"toml": "x = 1"})
            recorder.declare("measured", Channel("a", "N"))
            for number in range(40):
                recorder.block("measured", block(number))
                taken += 1
                until_s = time.monotonic() + 5.0
                while recorder._queue.qsize() and time.monotonic() < until_s:
                    time.sleep(0.0005)
    except RecorderFailed as error:
        failed.append(str(error))
    return taken, failed
