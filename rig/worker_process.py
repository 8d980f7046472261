"""A process of its own for what takes computing: tasks go there, results come back, nobody here ever waits.

No number is crunched in the acquisition process. A worker that dies, fails or cannot keep up is given up,
with a word on why; whoever feeds it goes on.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import chain, takewhile
from multiprocessing.connection import Connection
from typing import Any, Final, NamedTuple, Protocol

from daq.errors import RattleError
from daq.process import Child, send

QUEUE_ITEMS = 8192
"""Near 10 s of 64 channels, measured and predicted, in blocks of 0.15 s (4 bytes a sample: 250 MB)."""
_BATCH = 256
"""What has piled up goes out together: a message a block would cost the acquisition more than the copy."""
_START_S = 120.0
_POLL_S = 0.1
_NICE = 5
"""Where there are more to compute than cores, what is made of the samples waits, and not who takes them."""


class WorkerFailed(RattleError, RuntimeError):
    """A worker process ended before its work was complete."""


class Task(Protocol):
    """What a worker does; it is pickled on its way there."""

    def prepare(self) -> None:
        """Compile, warm up: whoever waits for the worker waits for this."""

    def run(self, items: Iterator[Any], send: Callable[[object], None]) -> None:
        """Work on what is handed over, until that ends; `send` gives results."""


_READY: Final = "ready"


class _Done(NamedTuple):
    error: str = ""


class Crew:
    """Processes that have done a task and wait for the next, by name; leaving the context ends them."""

    def __init__(self) -> None:
        self._waiting: dict[str, Child] = {}

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *error: object) -> None:
        while self._waiting:
            _, child = self._waiting.popitem()
            with suppress(OSError):
                child.pipe.send(None)
            child.end(1.0)
            child.pipe.close()

    def has(self, name: str) -> bool:
        """Whether a process of that name waits, which need not start."""
        return name in self._waiting

    def hire(self, name: str, task: Task) -> Child:
        """A process that does `task`: the one of that name that waits, or a new one."""
        child = self._waiting.pop(name, None)
        if child is not None:
            with suppress(OSError):  # gone, which nobody would see but here
                child.pipe.send(task)
                return child
            child.end(0.0)
            child.pipe.close()
        return _started(name, task, stays=True)

    def keep(self, name: str, child: Child) -> None:
        """Take back one that has done its task."""
        self._waiting[name] = child


class WorkerProcess:
    """Handle of the process that does `task`; `name` is what people call it, such as "twin".

    `deliver` gets the results in a thread of ours; `error` says why there will be no more, and is empty while
    all is well. Leaving the context ends the process, whatever it does; one of a `crew` goes back to it when
    it has done all its work. `give` is for any thread.
    """

    def __init__(
        self,
        name: str,
        task: Task,
        deliver: Callable[[Any], None],
        queue_items: int = QUEUE_ITEMS,
        crew: Crew | None = None,
    ) -> None:
        self._name, self._task, self._crew = name, task, crew
        self._deliver = deliver
        self._outbox: queue.Queue[object] = queue.Queue(queue_items)
        self._ready, self._done, self._ending = threading.Event(), threading.Event(), threading.Lock()
        self.error = ""

    def __enter__(self) -> WorkerProcess:
        hire = partial(_started, stays=False) if self._crew is None else self._crew.hire
        self._child, self._closed = hire(self._name, self._task), False
        self._threads = [
            threading.Thread(target=run, name=f"{self._name} {what}", daemon=True)
            for run, what in ((self._send_all, "sender"), (self._receive, "receiver"))
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process and the threads; nothing is delivered after it. A second call does nothing."""
        if self._closed:
            return
        self._closed = True
        if not self._done.is_set():
            self._end(f"the {self._name} was ended")
        # a sender with much to send would wait for a process that takes it all for nothing
        goes_on = self._crew is not None and not self.error and not self._outbox.full()
        if not goes_on:
            self._child.end(1.0)
        with suppress(queue.Full):  # then the sender has something to send, and fails at it
            self._outbox.put_nowait(None)
        for thread in self._threads:
            thread.join()
        if self._crew is not None and goes_on:
            self._crew.keep(self._name, self._child)
        else:
            self._child.pipe.close()

    @property
    def pid(self) -> int | None:
        return self._child.pid

    def wait_ready(self, check: Callable[[], None] = lambda: None) -> None:
        """Wait until the task is prepared; raises WorkerFailed, and what `check` raises meanwhile."""
        deadline = time.monotonic() + _START_S
        while not self._ready.wait(_POLL_S):
            check()
            if time.monotonic() > deadline:
                self._end(f"the {self._name} did not start within {_START_S:g} s")
            if self._done.is_set():
                raise WorkerFailed(self.error)

    def give(self, item: object) -> None:
        """Hand something over; returns at once. A full queue ends the worker; then nothing is taken."""
        if self._done.is_set():
            return
        try:
            self._outbox.put_nowait(item)
        except queue.Full:
            self._end(f"the {self._name} is slower than the data")

    def finish(self, within_s: float, check: Callable[[], None] = lambda: None) -> None:
        """Say that all was handed over, and wait for the last result.

        Raises WorkerFailed, also where it takes longer than `within_s`, and what `check` raises meanwhile.
        """
        self.give(None)
        deadline = time.monotonic() + within_s
        while not self._done.wait(_POLL_S):
            check()
            if time.monotonic() > deadline:
                self._end(f"the {self._name} did not come to its end within {within_s:g} s")
        if self.error:
            raise WorkerFailed(self.error)

    def _end(self, why: str) -> None:
        """Take the worker for ended, once; `why` is empty where it did all its work."""
        with self._ending:
            if self._done.is_set():
                return
            self.error = why
            self._done.set()
        if why:
            self._child.process.terminate()

    def _send_all(self) -> None:
        """In a thread of its own: a worker that reads slowly must not hold up the acquisition."""
        with suppress(OSError):  # the receiver says what went wrong there
            batch: list[object] = []
            while not batch or batch[-1] is not None:
                batch = [self._outbox.get()]
                with suppress(queue.Empty):
                    while batch[-1] is not None and len(batch) < _BATCH:
                        batch.append(self._outbox.get_nowait())

                send(self._child.pipe, batch)

    def _receive(self) -> None:
        try:
            while not isinstance(message := self._child.pipe.recv(), _Done):
                if message == _READY:
                    self._ready.set()
                else:
                    self._deliver(message)
        except RattleError as error:  # of `deliver`, also where it is an OSError
            self._end(str(error))
        except (EOFError, OSError):
            self._end(f"the {self._name}'s process died")
        except Exception as error:  # top of a thread: whoever waits for the end is to hear of it
            self._end(_words_of(error))
        else:
            verb = "failed" if self._ready.is_set() else "did not start"
            self._end(message.error and f"the {self._name} {verb}: {message.error}")


def _started(name: str, task: Task, stays: bool) -> Child:
    child = Child(name, _work, task, stays)
    child.start()
    return child


def _work(pipe: Connection, task: Task | None, stays: bool) -> None:
    os.nice(_NICE)
    try:
        while task is not None:
            task.prepare()
            pipe.send(_READY)
            items = chain.from_iterable(iter(pipe.recv, None))  # of one batch after the other, until None
            given = takewhile(lambda item: item is not None, items)
            task.run(given, partial(send, pipe))
            pipe.send(_Done())
            if not stays:
                return
            deque(given, maxlen=0)  # what came after all that it took
            task = pipe.recv()
    except (EOFError, ConnectionError):  # whoever started it is gone
        return
    except Exception as error:  # top of a process
        traceback.print_exc(file=sys.stderr)
        with suppress(OSError):
            pipe.send(_Done(_words_of(error)))


def _words_of(error: Exception) -> str:
    return str(error) if isinstance(error, RattleError) else f"{type(error).__name__}: {error}"
