"""Runs a command of `rattle` as a user would, and says what it cost."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[2]
_LOOK_S = 2.0
_FAILED, _KILLED = 1, -int(signal.SIGKILL)
_WORKER_DIED = "a worker process died"
"""What `rattle` says where one that works for it was killed, as for want of memory."""


@dataclass(frozen=True, slots=True)
class Spent:
    """Wall and processor time in s, exit code (None: stopped), most memory of all processes in MB."""

    wall_s: float
    cpu_s: float
    exit_code: int | None
    memory_mb: float


def end_with_children() -> None:
    """Have this program, when it is told to end, leave by its ends, which stop what it runs."""
    for each in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(each, lambda number, _: sys.exit(128 + number))


def rattle(arguments: Sequence[str], output: Path, limit_s: float) -> Spent:
    """Run a command; what it says goes to `output`. It is stopped, with all it started, after `limit_s`.

    Its exit code is that of one that was killed where something that works for it was.
    """
    spent = run([sys.executable, "-m", "rig.start", *arguments], output, limit_s)
    killed = spent.exit_code == _FAILED and _WORKER_DIED in output.read_text(errors="replace")
    return replace(spent, exit_code=_KILLED) if killed else spent


def run(command: Sequence[str], output: Path, limit_s: float) -> Spent:
    """Run any command like that."""
    began, before = time.monotonic(), _children_s()
    with output.open("w") as text:
        process = subprocess.Popen(  # noqa: S603 - our own
            command,
            cwd=ROOT,
            stdout=text,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**os.environ, "RATTLE_SIMULATED": "0"},  # its cost is a first look's
        )
        watch = _Watch(process.pid)
        watch.start()
        try:
            exit_code: int | None = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            exit_code = None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            watch.stop()
    return Spent(time.monotonic() - began, _children_s() - before, exit_code, watch.most_mb)


class _Watch(threading.Thread):
    """Looks every now and then at the memory of a process and all that it started."""

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self.most_mb = 0.0
        self._pid, self._ended = pid, threading.Event()

    def run(self) -> None:
        while not self._ended.wait(_LOOK_S):
            self.most_mb = max(self.most_mb, _memory_mb(self._pid))

    def stop(self) -> None:
        self._ended.set()
        self.join()


def _memory_mb(pid: int) -> float:
    """Shared pages are divided among those that share them."""
    total = 0
    try:
        process = psutil.Process(pid)
        for each in (process, *process.children(recursive=True)):
            total += each.memory_full_info().pss
    except psutil.Error:  # it ended meanwhile
        return 0.0
    return total / 1e6


def _children_s() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime
