"""Keeps every block on its way to the log: one thread writes, one syncs, any thread hands over."""

from __future__ import annotations

import queue
import shutil
import threading
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from types import TracebackType

from daq.block import SampleBlock
from daq.channel import Channel
from daq.clock import Clock
from daq.errors import RecorderFailed
from daq.log.records import LEAST_FREE_BYTES, ClockRecord, Event, Gap, Impact
from daq.log.writer import QUIET_S, LogWriter

_QUEUE_ITEMS, _QUEUE_BYTES = 1 << 16, 400 << 20
"""Of samples 15 s of 64 channels at 51.2 kHz, measured and predicted: longer than a disk stalls."""
SYNC_S = 1.0  # with a chunk of 0.25 s, what a loss of power may cost
_LAST_WORDS = 4096  # what is missing of each channel, and events
_SHORT_S = 60.0  # of what it has been told to write: so long before it stops a recording says so
_HUNG_DISK_S = 30.0  # a run that waits for ever for its disk could not be ended


class Recorder:
    """Writes a log from a thread of its own; the first failed write stops it for good.

    Handing over never waits. It raises RecorderFailed once the writer has failed or the queue was full, which
    is the caller's sign to stop the rig: nothing is dropped in silence, and nothing comes behind a hole.
    `refused` counts what was handed over in vain; `waiting_bytes` are those of samples that wait. Why it
    ended and what of each channel is missing is written even so, at its end, as long as the writer can. With
    less than a GiB left on the disk none begins, and one that has begun tells a minute before, in `events`,
    and fails while it can still be finished.
    """

    def __init__(self, writer: LogWriter, clock: Clock) -> None:
        self._writer, self._clock = writer, clock
        self._queue: queue.Queue[tuple[Callable[[], None] | None, int]] = queue.Queue(_QUEUE_ITEMS)
        self.waiting_bytes, self._counting = 0, threading.Lock()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._closing = threading.Event()
        each_s = (("recorder to disk", writer.sync), ("recorder's room", self._check_room))  # one may stall
        self._looking = [
            threading.Thread(target=self._each_second, args=(look,), name=name, daemon=True)
            for name, look in each_s
        ]
        self._failure: RecorderFailed | None = None
        self._told: RecorderFailed | None = None  # by `close`
        self._writes = True  # until a write has failed
        self._last_words = deque[Callable[[], None]](maxlen=_LAST_WORDS)
        self._begun_s = clock.monotonic_s()
        self._told_short, self._news = False, deque[Event]()
        self.high_water = self.refused = 0
        self.blocks = 0

    def __enter__(self) -> Recorder:
        self._check_room()
        self._writer.open()
        self._thread.start()
        for thread in self._looking:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and error is self._told:
            return
        try:
            self.close()
        except RecorderFailed as failure:
            if error is None:
                raise
            if error is not failure.__cause__:  # what ended the run first is why it ended
                error.add_note(str(failure))

    def declare(self, origin: str, channel: Channel) -> None:
        """Declare a channel before its first block."""
        self._put(lambda: self._writer.declare(origin, channel))

    def metadata(self, name: str, record: Mapping[str, str]) -> None:
        self._put(lambda: self._writer.add_metadata(name, record))

    def block(self, origin: str, block: SampleBlock) -> None:
        """Record a block, stamped with the time at which the host has it: now."""
        host_ns = self._clock.unix_ns()
        self.blocks += 1
        self._put(lambda: self._writer.add_block(origin, block, host_ns), size=block.values.nbytes)

    def event(self, event: Event) -> None:
        self._put(lambda: self._writer.add_event(event), last_words=True)

    def gap(self, gap: Gap) -> None:
        """Record why samples are missing, before the block that follows them."""
        host_ns = self._clock.unix_ns()
        self._put(lambda: self._writer.add_gap(gap, host_ns))

    def due(self, origin: str, channel: str, end_sample: int, cause: str) -> None:
        """What of a channel's samples up to `end_sample`, due by now, does not come is a gap."""
        host_ns = self._clock.unix_ns()
        cause = f"not recorded: {self._failure}" if self._failure and self._writes else cause
        self._put(lambda: self._writer.due(origin, channel, end_sample, host_ns, cause), last_words=True)

    def impact(self, impact: Impact) -> None:
        """Record an impact, stamped with the time at which it was found: now."""
        host_ns = self._clock.unix_ns()
        self._put(lambda: self._writer.add_impact(impact, host_ns))

    def clock_record(self, record: ClockRecord) -> None:
        """Record how a device's clock lies."""
        self._put(lambda: self._writer.add_clock(record))

    def close(self) -> None:
        """Write what waits, finish the file; raises RecorderFailed if anything was lost."""
        try:
            self._finish()
        except RecorderFailed as failure:
            self._told = failure
            raise

    def _finish(self) -> None:
        if self._thread.is_alive():
            try:
                for write in (*self._last_words, None):
                    self._queue.put((write, 0), timeout=_HUNG_DISK_S)
                waits = -1
                while self._thread.is_alive() and waits != (waits := self._queue.qsize()):
                    self._thread.join(_HUNG_DISK_S)  # one that is slow has all of it in the end
            except queue.Full:
                pass
        self._closing.set()
        for thread in self._looking:
            thread.join(_HUNG_DISK_S)
        if any(thread.is_alive() for thread in (self._thread, *self._looking)):
            raise RecorderFailed(f"{self._writer.path}: the disk does not answer; the end of the run is lost")
        self._writer.close()
        if self._failure is not None:
            more = f"; {self.refused} more refused" if self.refused else ""
            raise RecorderFailed(f"{self._failure}{more}") from self._failure

    def _put(self, write: Callable[[], None], last_words: bool = False, size: int = 0) -> None:
        if self._failure is None:
            try:
                self._count(size)
                self._queue.put_nowait((write, size))
            except queue.Full:
                self._failure = RecorderFailed(f"{self._writer.path}: the disk is slower than the data")
        if self._failure is not None:
            if last_words:
                self._last_words.append(write)
            else:
                self.refused += 1
            raise self._failure
        self.high_water = max(self.high_water, self._queue.qsize())

    def _count(self, size: int) -> None:
        """Bytes that wait from now on, or no more; raises queue.Full where they would be too many."""
        with self._counting:
            if self.waiting_bytes + size > _QUEUE_BYTES:
                raise queue.Full
            self.waiting_bytes += size

    def events(self) -> tuple[Event, ...]:
        """What is new of the disk, once."""
        return tuple(self._news.popleft() for _ in range(len(self._news)))

    def _each_second(self, look: Callable[[], None]) -> None:
        """A disk that stalls holds nobody up but this thread."""
        while not self._closing.wait(SYNC_S):
            try:
                look()
            except Exception as error:  # top of a thread: the next hand-over tells the rig
                self._failed(error)
                return

    def _check_room(self) -> None:
        folder = self._writer.path.parent
        try:
            free = shutil.disk_usage(folder).free
            written = self._writer.path.stat().st_size if self._thread.is_alive() else 0
        except OSError as error:
            raise RecorderFailed(f"{folder}: {error.strerror}") from error
        left = f"{free / 1e9:.2f} GB free, and {LEAST_FREE_BYTES / 1e9:.2f} GB have to stay free"
        if free < LEAST_FREE_BYTES:
            raise RecorderFailed(f"{folder}: {left}; make room or name another folder")
        a_second = written / max(self._clock.monotonic_s() - self._begun_s, SYNC_S)
        if free < LEAST_FREE_BYTES + _SHORT_S * a_second and not self._told_short:
            self._told_short = True
            words = f"{folder}: {left}: the run stops within a minute if it goes on so; make room"
            self._news.append(Event(self._clock.unix_ns(), "warning", "recorder", "disk.short", words))

    def _failed(self, error: Exception) -> None:
        if not isinstance(error, RecorderFailed):
            error = RecorderFailed(f"{self._writer.path}: {type(error).__name__}: {error}")
        self._failure = self._failure or error

    def _run(self) -> None:
        while True:
            try:
                write, size = self._queue.get(timeout=QUIET_S)
            except queue.Empty:
                write, size = partial(self._writer.flush_if_older, self._clock.unix_ns(), quiet=True), 0
            if write is None:
                return
            if not self._writes:
                self._count(-size)
                continue
            try:
                write()
            except Exception as error:  # top of a thread: whatever it was, the next hand-over tells the rig
                self._writes = False
                self._failed(error)
                self._writer.abandon(error)
            self._count(-size)
