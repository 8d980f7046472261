"""What a person sees while a run goes on."""

from __future__ import annotations

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import count
from queue import SimpleQueue
from typing import Any, Final

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
)
from rich.table import Column
from rich.text import Text

from daq.clock import Clock, SystemClock
from daq.errors import RattleError, harmless
from rig.session.pace import Paces, Work, lasting

FIRST_START: Final = "up to a minute where it is compiled first"
"""Measured on two cores with nothing compiled: beam 17 s, planar crank 34 s, spatial crank 50 s, or 52 s on
real instruments. Whatever simulates first compiles for all."""


TOLD_FROM_S: Final = 3.0
"""What is over sooner needs no telling: whatever takes five seconds was expected to take four."""
_MEASURED_S, _EARLY = 1.0, 0.1
"""How long work is measured at least before it tells its own pace; until which share what was told counts."""
_READ_S: Final = 1.0
"""How long the last words may take to be read."""
_LOOK_S: Final = 0.1
_LINES: Final = 1 << 16


_BAR: Final = 12
"""Characters: with what a rig shows beside it in a terminal of 80."""
MOTION_S: Final = "s of motion"
LOG_S: Final = "s of the log"
MEGABYTES: Final = "MB"
IMPACTS: Final = "impacts"
_NO_QUARTERS: Final = ("s", MOTION_S, LOG_S, MEGABYTES, IMPACTS)
"""Units of what is measured, or over soon: on a pipe no quarters of it are told."""


class Terminal(Console):
    """Shows whatever stands in a text, in a table's cell too, and takes none of it for an order."""

    def render_str(self, text: str, **how: Any) -> Text:
        return super().render_str(harmless(text), **{**how, "markup": False, "emoji": False})


class Waiting:
    """How long is left of what takes `total` of some unit (0: nobody counts) and was told to take `told_s`.

    Until a tenth is done what was told counts, if anything was; then what it does in a second. It is over
    after `longest_s` at the latest, where that is given.
    """

    def __init__(
        self, total: float, told_s: float | None, clock: Clock, longest_s: float | None = None
    ) -> None:
        self._total, self._told_s, self._clock = total, told_s, clock
        self._longest_s = longest_s
        self._began_s = clock.monotonic_s()
        self._first: tuple[float, float] | None = None  # done and time at the first report, before it a start
        self._done, self._done_s = 0.0, self._began_s

    @property
    def taken_s(self) -> float:
        return self._clock.monotonic_s() - self._began_s

    def report(self, done: float) -> None:
        """So much is done, of `total`."""
        self._done, self._done_s = done, self._clock.monotonic_s()
        if self._first is None:
            self._first = done, self._done_s

    @property
    def share(self) -> float:
        """How much of the total is done."""
        return min(self._done / self._total, 1.0) if self._total else 1.0

    @property
    def left_s(self) -> float | None:
        """Seconds, none below 0; None where nobody can tell."""
        by_told = None if self._told_s is None else self._told_s - self.taken_s
        if by_told is not None and self._done < _EARLY * self._total:
            return max(by_told, 0.0)
        by_pace = self._by_pace()
        if self._longest_s is not None:
            known = [by_told or None, by_pace, max(self._longest_s - self.taken_s, 0.0)]
            return min(each for each in known if each is not None and each >= 0.0)
        return by_told if by_pace is None and by_told is not None and by_told > 0 else by_pace

    def _by_pace(self) -> float | None:
        """From the first report on: before it something starts, which comes but once.

        Measured for half as long as until then at least, for what works side by side reports at once.
        """
        if not self._total or self._first is None or self._done <= self._first[0]:
            return None
        first, first_s = self._first
        if self._done_s - first_s < max(_MEASURED_S, (first_s - self._began_s) / 2):
            return None
        pace = (self._done_s - first_s) / (self._done - first)
        return max(pace * (self._total - self._done) - (self._clock.monotonic_s() - self._done_s), 0.0)


class _Left(ProgressColumn):
    """The time left, or gone where nobody knows when it ends, and what else is told beside it."""

    def render(self, task: Task) -> Text:
        left_s: float | None = task.fields["waiting"].left_s
        at_most = "at most " if task.fields["at_most"] else ""
        words = [] if left_s is None else [f"{at_most}{lasting(left_s)} left"]
        if task.total is None and task.completed:
            words = [f"{lasting(task.completed)} so far"]
        return Text("   ".join([*words, *filter(None, [task.fields["beside"]()])]))


class Screen:
    """Lines and progress bars on the terminal; on a pipe, lines alone.

    `paces` knows how long work took here before. Each of `stages` is told what goes on, how far it is, of how
    much, the unit of both, and how many s are left, where that is known.
    """

    def __init__(self, console: Console, paces: Paces | None = None, clock: Clock | None = None) -> None:
        self.console = console
        self.stages: list[Callable[[str, float, float, str, float | None], None]] = []
        self.part = ""
        """Of what all stages are a part, said before each."""
        self.paces, self._clock = paces or Paces(), clock or SystemClock()
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

    def stage(
        self,
        text: str,
        done: float = 0.0,
        total: float = 0.0,
        unit: str = "s",
        left_s: float | None = None,
    ) -> None:
        """Tell what goes on now, but not the terminal; `total` is 0 where nobody knows how much it is."""
        for tell in self.stages:
            tell(f"{self.part}: {text}" if self.part else text, done, total, unit, left_s)

    @property
    def attended(self) -> bool:
        """Whether there is a person to press Enter."""
        return self.console.is_terminal and sys.stdin is not None and sys.stdin.isatty()

    def _show(self, show: Callable[[], None]) -> None:
        if self._queue is None:
            show()
        else:
            self._queue.put(show)

    def hold(self, text: str, ended: Callable[[], bool] = lambda: False) -> None:
        """Wait for Enter, where there is a person to press it, or until `ended`."""
        if self.attended:
            self.say(text)
            while not ended():
                if select.select([sys.stdin], [], [], _LOOK_S)[0]:
                    sys.stdin.readline()
                    return

    def entered(self) -> bool:
        """Whether Enter was pressed, or a line came by a pipe, since this was asked last; never waits."""
        return self.line() is not None

    def line(self) -> str | None:
        """What was typed before Enter since this was asked last; None without an Enter. Never waits."""
        text, enter, _ = (_typed() or b"").partition(b"\n")
        return text.decode(errors="replace").strip() if enter else None

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

    def confirm(self, text: str, ended: Callable[[], bool] | None = None, at_terminal: bool = False) -> None:
        """Wait for Enter, or until `ended`; raises RattleError where nobody can press it.

        What was typed at a terminal before it was asked is no answer, nor is, where a person has to be
        `at_terminal`, a line by a pipe: it may be meant for somebody else.
        """
        if at_terminal and not (sys.stdin is not None and sys.stdin.isatty()):
            raise RattleError(f"{text}nobody is there to confirm it (standard input is no terminal)")
        while sys.stdin is not None and sys.stdin.isatty() and _typed():
            pass
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
    def busy(self, text: str, work: Work | None = None, unknown: str = "") -> Iterator[None]:
        """Show that something goes on of which nobody counts what is done, and how long it takes.

        `unknown` is said where no such work was done here before.
        """
        told_s = self._expected_s(work)
        self.stage(text, left_s=told_s)
        about = unknown if told_s is None else _about(told_s)
        with self._timed(work, 0.0, told_s) as waiting:
            if self.console.is_terminal:
                with self._shown(
                    f"{text} ({unknown})" if told_s is None and unknown else text, None, waiting
                ):
                    yield
            else:
                self.say(f"{text}{f' ({about})' if about else ''} ...")
                yield

    @contextmanager
    def bar(
        self,
        text: str,
        total: float,
        unit: str = "s",
        work: Work | None = None,
        beside: Callable[[], str] = lambda: "",
        longest_s: float | None = None,
    ) -> Iterator[Callable[[float], None]]:
        """A progress bar up to `total` seconds, or what `unit` says; on a pipe, of a count each quarter.

        Where `total` is 0 s a person ends it, nobody knows when, and how long it has gone on is shown.
        What it gives is told how far it is, in that unit; `beside` says what else there is to see. How long
        `work` takes is told at the start or, where nobody knows, once it is measured. It may end
        with less than `total`, after `longest_s` at the latest; then what is told is the most that it takes.
        """
        told_s = self._expected_s(work)
        if longest_s is not None:
            told_s = longest_s if told_s is None else min(told_s, longest_s)
        endless = not total and unit == "s"
        known_s = (total or None) if work is None and unit == "s" else told_s
        self.stage(text, 0.0, total, unit, known_s)
        with self._timed(work, total, known_s, longest_s) as waiting:
            if self.console.is_terminal:
                at_most = longest_s is not None
                with self._shown(text, None if endless else total, waiting, beside, at_most) as show:

                    def shown(done: float) -> None:
                        waiting.report(done)
                        self.stage(text, done, total, unit, waiting.left_s)
                        show(done)

                    yield shown
                return
            about = [] if told_s is None else [f"{_about(told_s)}{' in all' if unit == 's' else ''}"]
            if longest_s is not None and told_s is not None:
                about = [f"at most {lasting(told_s)}"]
            size = ", ".join([*([] if endless else [f"{total:g} {unit}"]), *about])
            self.say(f"{text}{f' ({size})' if size else ''} ...")
            said, measured = 0, told_s is not None or work is None

            def quarters(done: float) -> None:
                nonlocal said, measured
                waiting.report(done)
                left_s = waiting.left_s
                self.stage(text, done, total, unit, left_s)
                if not measured and left_s is not None:
                    measured = True
                    if left_s + waiting.taken_s >= TOLD_FROM_S:
                        self.say(f"{text}: about {lasting(left_s)} left")
                if unit in _NO_QUARTERS:
                    return
                if (now := min(3, int(4 * done / total)) if total else 3) > said:
                    said = now
                    self.say(f"{text} {25 * now} %")

            yield quarters

    @contextmanager
    def _shown(
        self,
        text: str,
        total: float | None,
        waiting: Waiting,
        beside: Callable[[], str] = lambda: "",
        at_most: bool = False,
    ) -> Iterator[Callable[[float], None]]:
        counted = () if total is None else (BarColumn(_BAR),)
        left = _Left(Column(no_wrap=True))
        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), *counted, left)
        progress = Progress(*columns, console=self.console, transient=True)
        task = progress.add_task(harmless(text), total=total, waiting=waiting, beside=beside, at_most=at_most)
        self._show(progress.start)
        try:
            yield lambda done: progress.update(task, completed=done)
        finally:
            self._show(progress.stop)

    @contextmanager
    def within(self, what: str, work: Work | None) -> Iterator[None]:
        """Say at the start how long all that follows takes, where it was done here before."""
        told_s = self._expected_s(work)
        if told_s is not None:
            self.say(f"{what:<10} {_about(told_s)}")
        with self._timed(work, 0.0, told_s):
            yield

    @contextmanager
    def _timed(
        self, work: Work | None, total: float, told_s: float | None, longest_s: float | None = None
    ) -> Iterator[Waiting]:
        """Time what goes on within, and keep what it took if it comes to its end."""
        waiting = Waiting(total, told_s, self._clock, longest_s)
        yield waiting
        if work is not None:
            if longest_s is not None:  # it may have ended with less of it
                work = replace(work, units=work.units * waiting.share)
            seconds = waiting.taken_s
            self._show(
                lambda: self.paces.took(work, seconds)
            )  # a disk that hangs holds up nothing that moves

    def _expected_s(self, work: Work | None) -> float | None:
        expected_s = None if work is None or not work.units else self.paces.expected_s(work)
        return None if expected_s is None or expected_s < TOLD_FROM_S else expected_s


def _about(seconds: float) -> str:
    return f"about {lasting(seconds)}"


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
