"""The real command in a process of its own, as a person at a terminal has it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[2]
DEADLINE_S = 100.0


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def log(self) -> Path:
        """The log that its standard output names last."""
        line = next(line for line in reversed(self.out.splitlines()) if line.startswith("log "))
        return Path(line.split(maxsplit=1)[1].removeprefix("so far "))

    @property
    def goes_on(self) -> psutil.Process:
        """What goes on switching off a drive that did not answer, and says so."""
        why = r"(?:! stopping before its time .*\n)?"  # told beside it
        said = re.search(rf"MAY STILL BE ON: switch it off by hand\n{why}! process (\d+) goes on", self.out)
        assert said is not None, self.out
        return psutil.Process(int(said[1]))


class Command:
    """A command that runs; its standard output is read line by line."""

    def __init__(self, *arguments: object, typed: str | None = None) -> None:
        self._lines: list[str] = []
        # As the installed `rattle` does it, but for the main module, which every spawned process would import
        # again: half of a short run's time.
        self._process = subprocess.Popen(  # noqa: S603
            [sys.executable, "-m", "rig.start", *map(str, arguments)],
            cwd=ROOT,
            env=os.environ | {"PYTHONUNBUFFERED": "1", "COLUMNS": "200"},
            stdin=None if typed is None else subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.pid = self._process.pid
        if typed is not None:
            self.type(typed)

    def type(self, text: str) -> None:
        """On its standard input, which was asked for with `typed`; nothing once it has ended."""
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write(text)
            self._process.stdin.flush()

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None

    def await_line(self, beginning: str) -> str:
        """Read on to the line that begins like that; the test's own time limit is the deadline."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.append(line)
            if line.startswith(beginning):
                return line.rstrip()
        raise AssertionError(f"{beginning!r} never came: {''.join(self._lines)}{self.end().err}")

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def children(self) -> list[psutil.Process]:
        return psutil.Process(self.pid).children(recursive=True)

    def end(self, deadline_s: float = DEADLINE_S) -> Ended:
        """Wait until it has ended by itself."""
        out, err = self._process.communicate(timeout=deadline_s)
        assert "Traceback" not in err, err
        return Ended(self._process.returncode, "".join(self._lines) + out, err)

    def kill(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()
        self._process.wait()


@contextmanager
def command(*arguments: object, typed: str | None = None) -> Iterator[Command]:
    """A command that is gone at the end, whatever the test did; `typed` is on its standard input."""
    running = Command(*arguments, typed=typed)
    try:
        yield running
    finally:
        running.kill()


def rattle(*arguments: object, deadline_s: float = DEADLINE_S, typed: str | None = None) -> Ended:
    """Run a command to its end."""
    with command(*arguments, typed=typed) as running:
        return running.end(deadline_s)


def await_gone(processes: list[psutil.Process], deadline_s: float = 8.0) -> None:
    """Wait until all are gone; emulators and workers end with their parent."""
    _, alive = psutil.wait_procs(processes, timeout=deadline_s)
    assert not alive, f"still there: {alive}"


def await_true(what: str, holds: Callable[[], object], deadline_s: float = 20.0) -> None:
    """Wait for a condition that another process brings about."""
    deadline = time.monotonic() + deadline_s
    while not holds():
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(0.01)
