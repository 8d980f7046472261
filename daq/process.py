"""Child processes: how each is started, what of the terminal reaches it, how it ends with its parent.

A child is a fresh interpreter: it imports what its entry and its arguments are made of and nothing else, and
has neither threads nor locks of its parent. One duplex pipe joins the two; what goes over it is pickled.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

OF_THE_TERMINAL: Final = frozenset({signal.SIGINT, signal.SIGHUP, signal.SIGQUIT})
"""What a terminal sends to all of its processes: for the one that brings the rig to its safe state, not for
those that it needs on the way."""


def send(pipe: Connection, what: object) -> None:
    """As `pipe.send`, of blocks of samples in an eighth of its time: that pickles into a file that grows."""
    pipe.send_bytes(pickle.dumps(what, pickle.HIGHEST_PROTOCOL))


class Child:
    """A process that calls `entry(pipe, *arguments)`; both are pickled on their way there.

    It never hears the signals `deaf_to`, and gives memory back unless `keeps_memory` (see
    `give_memory_back`). Once whoever started it is gone, killed or not, it has `grace_s` to
    end by itself, and is then ended whatever it does; None: it outlives its parent.
    """

    def __init__(
        self,
        name: str,
        entry: Callable[..., None],
        *arguments: object,
        deaf_to: Collection[signal.Signals] = OF_THE_TERMINAL,
        grace_s: float | None = 0.0,
        keeps_memory: bool = False,
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, self._far_end = context.Pipe()
        self.process = context.Process(
            target=_child,
            args=(entry, self._far_end, arguments, grace_s, keeps_memory),
            name=name,
            daemon=True,
        )
        self._deaf_to = deaf_to

    def start(self) -> None:
        """Start the process; returns before it has begun to import."""
        try:
            with imports_nothing_here(), deaf(self._deaf_to):
                self.process.start()
        finally:
            self._far_end.close()

    @property
    def pid(self) -> int | None:
        """None before the start."""
        return self.process.pid

    @property
    def alive(self) -> bool:
        """Whether it runs still, or is stopped by a signal."""
        return self.process.is_alive()

    def end(self, patience_s: float, terminate_s: float | None = None) -> None:
        """Wait until it has ended, then terminate it and wait `terminate_s`, if given, then kill it.

        The pipe stays open, for what the process said last. One that was never started has ended.
        """
        if self.pid is None:
            return
        self.process.join(patience_s)
        if terminate_s is not None and self.process.is_alive():
            self.process.terminate()
            self.process.join(terminate_s)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()

    def leave(self) -> None:
        """Let it go on by itself: what is still there at this process's end is ended and waited for."""
        multiprocessing.process._children.discard(self.process)  # type: ignore[attr-defined]


_SAFE_PATH, _OURS = "PYTHONSAFEPATH", "rattle"
_STARTING = threading.Lock()
"""Over that variable of the environment."""


@contextmanager
def imports_nothing_here() -> Iterator[None]:
    """Processes that start meanwhile import nothing from the working folder before they know where to look.

    Somebody's data lie there, and among them perhaps a `socket.py`. What they start themselves is as ever.
    """
    with _STARTING:
        ours = os.environ.setdefault(_SAFE_PATH, _OURS) == _OURS
        try:
            yield
        finally:
            if ours:
                del os.environ[_SAFE_PATH]


_OF_A_HANG_UP = {signal.SIGHUP, signal.SIGQUIT}
"""What would end Python's resource tracker, which by itself is deaf to SIGINT and SIGTERM only."""


@contextmanager
def deaf(signals: Collection[signal.Signals]) -> Iterator[None]:
    """Processes that start meanwhile inherit these as blocked, for good: none can come before they care."""
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _OF_A_HANG_UP)
    try:
        # Python starts this one beside the first child, and unblocks SIGINT and SIGTERM after it.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, signals)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def begin_as_child(grace_s: float | None = 0.0) -> None:
    """End this process that long after the one that started it, if at all; for a pool's workers too."""
    if os.environ.get(_SAFE_PATH) == _OURS:
        del os.environ[_SAFE_PATH]
    if grace_s is None:
        return

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()  # a pipe that only the parent holds: it closes however that ends
            time.sleep(grace_s)
            os._exit(1)

    threading.Thread(target=watch, name="parent watch", daemon=True).start()


_NICE = 5
"""A third of what others get; at 10, a tenth, a browser on the same machine leaves a live view too little."""
_TRIES, _BETWEEN_TRIES_S = 5, 0.15


def give_way() -> None:
    """Let others compute first where there are more to compute than cores; for one with a session of its own.

    Linux may share the processor between sessions first, each with a value of its own: sched(7), "The
    autogroup feature". One may be set in 0.1 s, by whomever.
    """
    os.nice(_NICE)
    for _ in range(_TRIES):
        try:
            Path("/proc/self/autogroup").write_text(str(_NICE))
        except BlockingIOError:
            time.sleep(_BETWEEN_TRIES_S)
            continue
        except OSError:  # it does not
            pass
        return


_ARENA_MAX: Final = -8
"""Of mallopt(3)."""


def give_memory_back(every_s: float = 10.0) -> None:
    """Have this process give what it has freed back to the system every so often.

    What waits while a disk stalls is freed in between what stays, and glibc keeps that for itself: after a
    night of stalls a process is as large as the worst of them has made it. And it gives each thread a heap of
    its own to do that in: call this before threads are started, and they share one.
    """
    glibc = ctypes.CDLL(None)
    trim = getattr(glibc, "malloc_trim", None)  # of glibc alone
    if trim is not None:
        glibc.mallopt(_ARENA_MAX, 1)

    def keep_small() -> None:
        while trim is not None:
            time.sleep(every_s)
            trim(0)

    threading.Thread(target=keep_small, name="memory", daemon=True).start()


def _child(
    entry: Callable[..., None],
    pipe: Connection,
    arguments: tuple[Any, ...],
    grace_s: float | None,
    keeps_memory: bool,
) -> None:
    with suppress(OSError):  # for top and ps; where a system has no such file it is python there
        Path("/proc/self/comm").write_text(multiprocessing.current_process().name)
    if not keeps_memory:
        give_memory_back()
    begin_as_child(grace_s)
    entry(pipe, *arguments)
