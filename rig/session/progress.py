"""What a person sees while a run goes on."""

from __future__ import annotations

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from queue import SimpleQueue
from typing import Any, Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

from daq.errors import RattleError, harmless

FIRST_START: Final = "compiled on a first start, which takes up to a minute"
"""Measured on two cores with nothing compiled: beam 17 s, planar crank 34 s, spatial crank 50 s, or 52 s on
real instruments. Whatever simulates first compiles for all."""


_READ_S: Final = 1.0
"""How long the last words may take to be read."""
_LOOK_S: Final = 0.1
_LINES: Final = 1 << 16


class Terminal(Console):
    """Shows whatever stands in a text, in a table's cell too, and takes none of it for an order."""

    def render_str(self, text: str, **how: Any) -> Text:
        return super().render_str(harmless(text), **{**how, "markup": False, "emoji": False})


class Screen:
    """Lines and progress bars on the terminal; on a pipe, lines alone."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self._queue: SimpleQueue[Callable[[], None] | None] | None = None

    @contextmanager
    def apart(self) -> Iterator[None]:
        """A thread writes meanwhile: a terminal that stops reading, or is gone, delays nothing."""
        if (queue := self._queue) is None:
            queue = self._queue = SimpleQueue()
            threading.Thread(target=_write, args=(queue,), name="screen", daemon=True).start()
        try:
            yield
        finally:
            read = threading.Event()
            queue.put(read.set)
            if read.wait(_READ_S):  # else it stays as it is until somebody reads on
                self._queue = None
                queue.put(None)

    def say(self, text: str, style: str | None = None) -> None:
        self._show(
            lambda: self.console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)
        )

    def warn(self, text: str) -> None:
        self.say(f"! {text}", "yellow")

    def _show(self, show: Callable[[], None]) -> None:
        if self._queue is None:
            show()
        else:
            self._queue.put(show)

    def hold(self, text: str, ended: Callable[[], bool] = lambda: False) -> None:
        """Wait for Enter, where there is a person to press it, or until `ended`."""
        if self.console.is_terminal and sys.stdin.isatty():
            self.say(text)
            while not ended():
                if select.select([sys.stdin], [], [], _LOOK_S)[0]:
                    sys.stdin.readline()
                    return

    def entered(self) -> bool:
        """Whether Enter was pressed, or a line came by a pipe, since this was asked last; never waits."""
        return b"\n" in (_typed() or b"")

    def nobody_enters(self) -> bool:
        """Whether the input is at its end; what came before is gone. Never waits."""
        return any(_typed() == b"" for _ in range(2))

    def enter_pressed(self) -> Callable[[], bool]:
        """Like `entered`, but of what was there when it is asked first it knows nothing."""
        asked = count()

        def pressed() -> bool:
            entered = self.entered()
            return next(asked) > 0 and entered

        return pressed

    def confirm(self, text: str, ended: Callable[[], bool] | None = None) -> None:
        """Wait for Enter, or until `ended`; raises RattleError where nobody can press it."""
        try:
            if ended is not None and sys.stdin is not None:  # a line that is read begins no wait anew
                self.console.print(text, end="", markup=False)
                text = ""
                while not select.select([sys.stdin], [], [], _LOOK_S)[0]:
                    if ended():
                        return
            self.console.input(text, markup=False)
        except EOFError as error:
            raise RattleError("nobody is there to confirm what is done by hand (end of input)") from error

    @contextmanager
    def busy(self, text: str) -> Iterator[None]:
        """Show that something goes on that has no length."""
        if not self.console.is_terminal:
            self.say(f"{text} ...")
            yield
            return
        with self.console.status(text):
            yield

    @contextmanager
    def bar(self, text: str, total: float, unit: str = "s") -> Iterator[Callable[[float], None]]:
        """A progress bar up to `total` seconds, or what `unit` says; on a pipe, a line each quarter.

        What it gives is told how far it is, in that unit.
        """
        if not self.console.is_terminal:
            self.say(f"{text} ({total:g} {unit}) ...")
            said = 0

            def quarters(done: float) -> None:
                nonlocal said
                if (now := min(3, int(4 * done / total)) if total else 3) > said:
                    said = now
                    self.say(f"{text} {25 * now} %")

            yield (lambda done: None) if unit == "s" else quarters
            return
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        progress = Progress(*columns, console=self.console, transient=True)
        task = progress.add_task(text, total=total)
        self._show(progress.start)
        try:
            yield lambda done: progress.update(task, completed=done)
        finally:
            self._show(progress.stop)


def _typed() -> bytes | None:
    """What waits on the input; None if nothing does, nothing at its end."""
    if sys.stdin is None:
        return b""
    there = select.select([sys.stdin], [], [], 0)[0]
    return os.read(sys.stdin.fileno(), _LINES) if there else None


def _write(queue: SimpleQueue[Callable[[], None] | None]) -> None:
    for show in iter(queue.get, None):
        with suppress(Exception):  # whatever a line does to a terminal, the next ones are shown
            show()
