"""The acquisition's side of the live view: hands over copies and never waits."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import pickle
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import psutil

from daq.errors import InstrumentAbsent
from daq.log.records import Event, Impact
from daq.process import Child
from rig.live.picture import Layout
from rig.stream import Block, Record, Shape

LAST_WORDS_S = 1.5
"""What is still on its way when the run ends has this long to reach the viewer."""
_START_TIMEOUT_S = 30.0
_WINDOW_S, _CYCLES = 3.0, 8
"""What plots over time show: so many cycles can be told from each other."""
_QUEUE_BYTES_A_TRACE = 512 << 10
"""2.5 s at 51.2 kHz: a twin that has just aligned sends its first seconds at once."""
_LEAST_TRACES = 32
_PATIENCE_S = 0.7
"""The page is at most that far behind the newest sample, and what it takes to draw it."""
_PERIOD_S = 0.05
"""Records leave in batches: one wake-up of the thread in 50 ms, not one a block, and no eye sees 50 ms."""


class Dropped(NamedTuple):
    """How many records the sender has thrown away so far."""

    records: int


class Progress(NamedTuple):
    """What the run is at, as the terminal says it; `done` of `total` (0: nobody knows), in `unit`.

    It is over at the Unix time `ends_s`, where that is known. `failed` where that is why it has ended.
    """

    text: str
    done: float = 0.0
    total: float = 0.0
    unit: str = "s"
    ends_s: float | None = None
    failed: bool = False


class Elsewhere(NamedTuple):
    """Where the page's reader can step through time: the address of Rerun's page."""

    url: str


class Levels(NamedTuple):
    """The largest magnitude of each measured channel in a reading that ends at `time_ns`, recorded or not."""

    time_ns: int
    most: list[float]


class Outcome(NamedTuple):
    """What a run came to: the sentences of its verdict, whether it is `well`, the file of its report."""

    sentences: tuple[str, ...]
    well: bool | None
    report: Path | None


class Swept(NamedTuple):
    """What the points of a sweep have come to: by title and whose, a bar's ends and marks at each of `at`.

    `label` and `ends` say what is swept, from where to where; None where a point has not come yet. `at` goes
    from 0 to 1.
    """

    label: str
    ends: tuple[str, str]
    at: list[float]
    plots: dict[str, dict[str, list[tuple[float, ...] | None]]]


OfThePage = Progress | Elsewhere | Levels | Swept | Outcome
"""What the operator's page shows and the time line does not."""
Shown = Block | Shape | Event | Impact | Dropped | Layout | OfThePage
"""What goes to the view's processes; of anything else no view shows something."""


def queue_bytes(layout: Layout) -> int:
    """How much may wait on its way to who shows these channels."""
    return max(sum(map(len, layout.origins.values())), _LEAST_TRACES) * _QUEUE_BYTES_A_TRACE


class _Waiting(NamedTuple):
    since_s: float
    pickled: bytes
    ages: bool
    """Whether a newer one says more: samples do, events and layouts do not."""


class Sender:
    """Pickled records in memory, at most `maximum_bytes` of them, and a thread that sends them.

    A full memory drops its oldest record. Where the oldest has waited for `patience_s`, the blocks that wait
    with it are dropped together, so that a slow reader sees the newest and not all. Both are counted in
    `dropped`; the reader is told of these and of those `lost_before`. Once the reader is gone `broken` is set
    and nothing is kept.
    """

    def __init__(
        self,
        pipe: Connection,
        maximum_bytes: int = _LEAST_TRACES * _QUEUE_BYTES_A_TRACE,
        patience_s: float = math.inf,
    ) -> None:
        self.dropped = 0
        self.lost_before = 0
        self.broken = False
        self._pipe = pipe
        self.maximum_bytes = maximum_bytes
        self._patience_s = patience_s
        self._waiting: deque[_Waiting] = deque()
        self._bytes = 0
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live view sender", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def offer(self, record: Record | Shown) -> None:
        """Queue a copy of a record that a view shows; returns at once, whatever the reader does."""
        if not self._stop.is_set() and isinstance(record, Shown):
            pickled = b"" if self.broken else pickle.dumps(record, pickle.HIGHEST_PROTOCOL)
            self.pass_on(pickled, ages=isinstance(record, Block | Shape))

    def pass_on(self, pickled: bytes, ages: bool) -> None:
        """Queue a record that has been pickled already."""
        if self.broken:
            self.dropped += 1
            return
        with self._lock:
            self._waiting.append(_Waiting(time.monotonic(), pickled, ages))
            self._bytes += len(pickled)
            while self._bytes > self.maximum_bytes:
                self._bytes -= len(self._waiting.popleft().pickled)
                self.dropped += 1

    def _next(self) -> bytes | None:
        """What is to be sent next, if anything waits."""
        with self._lock:
            if self._waiting and time.monotonic() - self._waiting[0].since_s > self._patience_s:
                kept = [each for each in self._waiting if not each.ages]
                self.dropped += len(self._waiting) - len(kept)
                self._waiting = deque(kept)
                self._bytes = sum(len(each.pickled) for each in kept)
            if not self._waiting:
                return None
            pickled = self._waiting.popleft().pickled
            self._bytes -= len(pickled)
            return pickled

    def close(self, timeout_s: float | None) -> None:
        """Send what is queued, at most `timeout_s` (None: until the reader is gone), and that it was all."""
        self._stop.set()
        self._thread.join(timeout_s)
        with self._lock:
            self._waiting.clear()

    def _run(self) -> None:
        told = 0
        try:
            while True:
                stopping = self._stop.wait(_PERIOD_S)
                if told != self.dropped + self.lost_before:
                    told = self.dropped + self.lost_before
                    self._pipe.send(Dropped(told))
                while (pickled := self._next()) is not None:
                    self._pipe.send_bytes(pickled)
                if stopping:
                    self._pipe.send(None)
                    return
        except OSError:
            self.broken = True  # the reader died; the log does not depend on it


class Processes(NamedTuple):
    """Their ids: the operator's page, Rerun's time line, Rerun's own server."""

    page: int
    time_line: int
    server: int


class LiveView:
    """Shows a run while it runs; opened and closed in one thread, offered to from any.

    The operator's page at `page_port` is told of it from the start on; 0 is a page of its own, at `page_url`.
    `url` is that of Rerun's time line. Three processes work behind it, all on loopback only: one tells the
    page, and hands on what it got to the one that talks to Rerun, which takes many times as long; Rerun's own
    server belongs to that. When they stall or die, what is offered is dropped and counted in `dropped`; the
    caller does not notice. In Rerun measured data waits up to `patience_s` for its prediction, so that both
    appear together.
    """

    offer: Callable[[Record | Shown], None]
    """Shows a record if there is time and a place for it; there once the view is started."""

    def __init__(
        self,
        layout: Layout | None = None,
        patience_s: float = 3.0,
        memory_limit: str = "64MB",
        page_port: int = 0,
    ) -> None:
        self.url = ""
        self.sink_url = ""
        self.page_url = ""
        self._layout = layout
        self._patience_s = patience_s
        self._memory_limit = memory_limit
        self._page_port = page_port
        self._started = self._open = False

    def start(self) -> LiveView:
        """Start the processes, which takes seconds; what is offered from now on waits for them."""
        self._complaints = tempfile.NamedTemporaryFile()  # noqa: SIM115  closed in close()
        said = self._complaints.name
        reading, writing = multiprocessing.Pipe(duplex=False)
        with reading, writing:
            arguments = (reading, said, self._patience_s, self._memory_limit)
            self._time_line = Child("time line", _time_line, *arguments, grace_s=LAST_WORDS_S)
            self._time_line.start()
            self._page = Child("live view", _page, writing, said, self._page_port, grace_s=LAST_WORDS_S)
            self._page.start()
        self._sender = Sender(self._page.pipe, patience_s=_PATIENCE_S)
        self._sender.start()
        self.offer = self._sender.offer
        self._started = True
        if self._layout is not None:
            self.show(self._layout)
        return self

    def show(self, layout: Layout) -> None:
        """Show these channels from now on."""
        self._sender.maximum_bytes = queue_bytes(layout)
        cycles_s = math.inf if layout.cycle_s is None else _CYCLES * layout.cycle_s
        self.offer(replace(layout, window_s=min(_WINDOW_S, cycles_s)))

    def open(self) -> LiveView:
        """Start, and wait until all is there; raises InstrumentAbsent if it does not come."""
        if not self._started:
            self.start()
        [self.page_url] = self._answer_of(self._page)
        self.url, self.sink_url, server = self._answer_of(self._time_line)
        self.offer(Elsewhere(self.url))
        self._server = psutil.Process(server)
        self._open = True
        return self

    def _answer_of(self, child: Child) -> tuple[Any, ...]:
        """What it says once it is there; raises InstrumentAbsent, with all ended, if it does not come."""
        answer: Any = ""
        with contextlib.suppress(EOFError, OSError):
            answer = child.pipe.recv() if child.pipe.poll(_START_TIMEOUT_S) else ""
        if isinstance(answer, tuple):
            return answer
        lines = self._complaints.read().decode(errors="replace").split("\n")
        said = next((line for line in reversed(lines) if line.strip()), "no word from it")
        self.close(0.0)
        raise InstrumentAbsent("live view", "127.0.0.1", answer or f"it did not start: {said}")

    @property
    def dropped(self) -> int:
        """Blocks, impacts, shapes and events that were offered and will not be shown."""
        return self._sender.dropped

    @property
    def alive(self) -> bool:
        """Whether all of its processes still run (they may be stalled)."""
        if not (self._open and self._page.alive and self._time_line.alive and self._server.is_running()):
            return False
        return self._server.status() != psutil.STATUS_ZOMBIE

    @property
    def processes(self) -> Processes:
        return Processes(self._page.pid or 0, self._time_line.pid or 0, self._server.pid)

    def close(self, timeout_s: float = 4.0) -> None:
        """Let the view show what it has, at most `timeout_s`, and end its processes."""
        if not self._started:
            return
        deadline = time.monotonic() + timeout_s
        self._sender.close(timeout_s / 3)
        for child in (self._page, self._time_line):  # in the order in which each has the last of it
            child.end(max(deadline - time.monotonic(), 0.0))
        # the server dies with the process that it belongs to, unless that was killed too early
        if self._open:
            with contextlib.suppress(psutil.NoSuchProcess):
                self._server.kill()
        self._started = self._open = False
        self._sender.close(None)
        for child in (self._page, self._time_line):
            child.pipe.close()
        self._complaints.close()

    def __enter__(self) -> LiveView:
        return self.open()

    def __exit__(self, *error: object) -> None:
        self.close()


def _page(pipe: Connection, onward: Connection, complaints: str, page_port: int) -> None:
    _apart(complaints)
    from rig.live.page_process import tell_page

    tell_page(pipe, onward, page_port)


def _time_line(
    pipe: Connection, records: Connection, complaints: str, patience_s: float, memory_limit: str
) -> None:
    _apart(complaints)
    from rig.live.time_line_process import serve

    serve(pipe, records, patience_s, memory_limit)


def _apart(complaints: str) -> None:
    """In a session of its own, and what is printed goes to a file: neither is the terminal's."""
    os.setsid()
    with open(complaints, "ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
