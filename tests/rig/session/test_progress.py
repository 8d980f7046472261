"""What a person sees where there is no terminal."""

from __future__ import annotations

import errno
import os
import pty
import threading
import time
from io import StringIO

import pytest
from rich.console import Console

from daq.errors import RattleError
from rig.session.progress import Screen, Terminal


def said(total: float, unit: str, steps: int) -> list[str]:
    out = StringIO()
    with Screen(Console(file=out)).bar("simulating", total, unit) as bar:
        for done in range(steps + 1):
            bar(done * total / steps)
    return out.getvalue().splitlines()


class StalledTerminal(StringIO):
    """Takes nothing until somebody reads on."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = threading.Event()

    def write(self, text: str) -> int:
        self.reads.wait()
        return super().write(text)


def test_a_terminal_that_stops_reading_delays_nothing_and_misses_nothing() -> None:
    terminal = StalledTerminal()
    screen = Screen(Console(file=terminal))
    with screen.apart():
        with screen.bar("recording", 60.0) as bar:
            bar(1.0)
        screen.warn("a limit was passed")
    screen.say("log run.mcap")
    assert terminal.getvalue() == ""
    terminal.reads.set()
    with screen.apart():  # waits until what was said is read
        pass
    deadline = time.monotonic() + 5.0
    while "log run.mcap" not in terminal.getvalue():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert terminal.getvalue().splitlines() == [
        "recording (60 s) ...",
        "! a limit was passed",
        "log run.mcap",
    ]


class GoneTerminal(StringIO):
    def write(self, text: str) -> int:
        raise OSError(errno.EIO, "the terminal is gone")


def test_a_terminal_that_is_gone_ends_nothing() -> None:
    screen = Screen(Console(file=GoneTerminal()))
    with screen.apart():
        screen.warn("a limit was passed")


@pytest.mark.parametrize("how", ["Enter", "end of input", "a signal"])
def test_what_is_held_for_a_person_ends_by_enter_the_end_of_input_or_a_signal(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = pty.openpty()
    screen = Screen(Console(file=StringIO(), force_terminal=True))
    with open(theirs, encoding="ascii") as stdin, open(ours, "wb", buffering=0) as typed:
        monkeypatch.setattr("sys.stdin", stdin)
        if how != "a signal":
            typed.write({"Enter": b"\n", "end of input": b"\x04"}[how])
        screen.hold("Enter closes it", lambda: how == "a signal")


@pytest.mark.parametrize("how", ["Enter", "end of input", "a signal"])
def test_what_is_to_be_confirmed_does_not_outlast_a_signal(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with open(reading) as there, open(writing, "wb", buffering=0) as typed:
        monkeypatch.setattr("sys.stdin", there)
        screen = Screen(Console(file=StringIO()))
        if how == "Enter":
            typed.write(b"\n")
        elif how == "end of input":
            typed.close()
            with pytest.raises(RattleError, match="nobody is there to confirm"):
                screen.confirm("Enter once nobody is in danger: ", lambda: False)
            return
        screen.confirm("Enter once nobody is in danger: ", lambda: how == "a signal")


def test_a_count_is_told_by_quarters_and_seconds_are_not() -> None:
    quarters = [f"simulating {share} %" for share in (25, 50, 75)]
    assert said(3000, "rigs", 7) == ["simulating (3000 rigs) ...", *quarters]
    assert said(3000, "rigs", 1) == ["simulating (3000 rigs) ...", "simulating 75 %"]
    assert said(0, "rigs", 1)[0] == "simulating (0 rigs) ..."
    assert said(60, "s", 7) == ["simulating (60 s) ..."]


def test_whether_enter_was_pressed_is_told_without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a line is none, and neither is the end of the input."""
    reading, writing = os.pipe()
    with open(reading) as there, open(writing, "wb", buffering=0) as typed:
        monkeypatch.setattr("sys.stdin", there)
        screen = Screen(Terminal())
        assert not screen.entered()
        typed.write(b"half a li")
        assert not screen.entered()
        typed.write(b"ne\n")
        assert screen.entered()
        assert not screen.entered()
        typed.close()
        assert not screen.entered()


def test_an_enter_from_before_the_record_does_not_end_it(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with open(reading) as there, open(writing, "wb", buffering=0) as typed:
        monkeypatch.setattr("sys.stdin", there)
        screen = Screen(Terminal())
        assert not screen.nobody_enters()
        pressed = screen.enter_pressed()
        typed.write(b"\n\n")
        assert [pressed(), pressed()] == [False, False]
        typed.write(b"\n")
        assert [pressed(), pressed()] == [True, False]
        typed.close()
        assert screen.nobody_enters()
