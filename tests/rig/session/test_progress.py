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
from rig.session.pace import Paces, Work
from rig.session.progress import Screen, Terminal, Waiting


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


def test_a_line_by_a_pipe_is_no_person(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be the next name of a loop that reads them."""
    reading, writing = os.pipe()
    with open(reading) as there, open(writing, "wb", buffering=0) as typed:
        monkeypatch.setattr("sys.stdin", there)
        typed.write(b"next.toml\n")
        with pytest.raises(RattleError, match=r"once nobody is in danger: nobody is there .*no terminal"):
            Screen(Console(file=StringIO())).confirm("Enter once nobody is in danger: ", at_terminal=True)
        assert there.readline() == "next.toml\n"


def test_what_was_typed_before_a_question_is_no_answer_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = pty.openpty()
    with open(theirs, encoding="ascii") as stdin, open(ours, "wb", buffering=0) as typed:
        monkeypatch.setattr("sys.stdin", stdin)
        typed.write(b"\n\n")
        looks: list[None] = []

        def answer() -> bool:
            looks.append(None)
            if len(looks) == 2:
                typed.write(b"\n")
            return False

        Screen(Console(file=StringIO())).confirm("Enter once nobody is in danger: ", answer)
    assert len(looks) == 2


def test_a_count_is_told_by_quarters_and_seconds_are_not() -> None:
    quarters = [f"simulating {share} %" for share in (25, 50, 75)]
    assert said(3000, "rigs", 7) == ["simulating (3000 rigs) ...", *quarters]
    assert said(3000, "rigs", 1) == ["simulating (3000 rigs) ...", "simulating 75 %"]
    assert said(0, "rigs", 1)[0] == "simulating (0 rigs) ..."
    assert said(60, "s", 7) == ["simulating (60 s) ..."]
    assert said(0, "s", 7) == ["simulating ..."]


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
        typed.write(b" 37 deg \n")
        assert screen.line() == "37 deg"
        assert screen.line() is None
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


class Moment:
    """A clock that stands until it is moved."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic_s(self) -> float:
        return self.now_s


class Known(Paces):
    """What everything is expected to take, and what it took."""

    def __init__(self, expected_s: float | None) -> None:
        super().__init__()
        self._expected, self.kept = expected_s, list[tuple[Work, float]]()

    def expected_s(self, work: Work) -> float | None:
        return self._expected

    def took(self, work: Work, seconds: float) -> None:
        self.kept.append((work, seconds))


def timed(expected_s: float | None, terminal: bool = False) -> tuple[Screen, Known, Moment, StringIO]:
    out, paces, clock = StringIO(), Known(expected_s), Moment()
    console = Console(file=out, force_terminal=terminal, width=120)
    return Screen(console, paces, clock), paces, clock, out  # type: ignore[arg-type]


WORK = Work("predict", 10.0)


def test_work_that_was_done_before_is_told_of_at_its_start_and_kept_at_its_end() -> None:
    screen, paces, clock, out = timed(75.0)
    with screen.busy("predicting", WORK):
        assert out.getvalue() == "predicting (about 1 min 15 s) ...\n"
        clock.now_s = 80.0
    assert paces.kept == [(WORK, 80.0)]
    with screen.bar("simulating", 48, "rigs", WORK):
        assert out.getvalue().splitlines()[1:] == ["simulating (48 rigs, about 1 min 15 s) ..."]
    with screen.within("lasts", WORK):
        assert out.getvalue().splitlines()[-1] == "lasts      about 1 min 15 s"


def test_seconds_that_something_comes_before_are_told_with_it() -> None:
    """A motor that has to come up before it settles."""
    screen, _, _, out = timed(8.4)
    with screen.bar("settling", 1.0, "s", WORK):
        assert out.getvalue() == "settling (1 s, about 8 s in all) ...\n"


def test_what_is_soon_over_or_never_was_done_is_not_told_of() -> None:
    for expected_s in (2.0, None):
        screen, _, _, out = timed(expected_s)
        with screen.busy("predicting", WORK), screen.within("lasts", WORK):
            assert out.getvalue() == "predicting ...\n"
    screen, _, _, out = timed(None)
    with screen.busy("starting", WORK, "up to a minute"):
        assert out.getvalue() == "starting (up to a minute) ...\n"


def test_work_that_fails_or_is_stopped_tells_nothing_of_the_next() -> None:
    screen, paces, _, _ = timed(None)
    for shown in (screen.busy("predicting", WORK), screen.bar("simulating", 48, "rigs", WORK)):
        with pytest.raises(KeyboardInterrupt), shown:
            raise KeyboardInterrupt
    assert paces.kept == []


def test_the_first_of_its_kind_is_measured_and_told_once() -> None:
    """By what it does once all has started, for as long as two at a time need to show it."""
    screen, _, clock, out = timed(None)
    with screen.bar("simulating", 80, "rigs", WORK) as bar:
        for clock.now_s, done in ((6.0, 8), (6.1, 16), (8.0, 24), (8.1, 32), (10.0, 40), (10.1, 48)):
            bar(done)
    told = [line for line in out.getvalue().splitlines() if "about" in line]
    assert told == ["simulating: about 5 s left"]  # 40 of 80 are left, 32 came in 4 s


def test_nothing_is_measured_of_what_nobody_asks_the_time_of() -> None:
    screen, _, clock, out = timed(None)
    with screen.bar("judging", 80, "rigs") as bar:
        for clock.now_s, done in ((6.0, 8), (12.0, 16), (60.0, 24)):
            bar(done)
    assert "about" not in out.getvalue()


def test_the_time_left_goes_by_what_was_told_and_then_by_what_is_done() -> None:
    clock = Moment()
    waiting = Waiting(100.0, 50.0, clock)  # type: ignore[arg-type]
    left = []
    for clock.now_s, done in ((5.0, 1.0), (10.0, 6.0), (15.0, 11.0), (20.0, 16.0)):
        waiting.report(done)
        left.append(waiting.left_s)
    assert left == [45.0, 40.0, 89.0, 84.0]
    clock.now_s = 24.0  # nothing new, but the clock goes on
    assert waiting.left_s == 80.0


def test_nobody_says_that_no_time_is_left_of_what_goes_on() -> None:
    clock = Moment()
    waiting = Waiting(0.0, 10.0, clock)  # type: ignore[arg-type]
    clock.now_s = 4.0
    assert waiting.left_s == 6.0
    clock.now_s = 11.0
    assert waiting.left_s is None


@pytest.mark.parametrize("counted", [True, False])
def test_a_terminal_shows_how_long_is_left_and_what_else_there_is(counted: bool) -> None:
    screen, _, clock, out = timed(75.0, terminal=True)
    if counted:
        with screen.bar(
            "recording", 90.0, beside=lambda: "contact.force_upper up to 43 % of its range"
        ) as bar:
            clock.now_s = 30.0
            bar(30.0)
    else:
        with screen.busy("predicting", WORK):
            clock.now_s = 15.0
    shown = out.getvalue()
    assert "1 min 0 s left" in shown
    assert ("contact.force_upper up to 43 % of its range" in shown) == counted


def test_of_what_ends_when_a_person_says_so_a_terminal_shows_how_long_it_has_gone_on() -> None:
    screen, _, clock, out = timed(None, terminal=True)
    with screen.bar("recording", 0.0) as bar:
        for clock.now_s in (1.0, 30.0, 75.0):
            bar(clock.now_s)
    assert "1 min 15 s so far" in out.getvalue()
    assert "left" not in out.getvalue()


def test_what_may_end_sooner_is_told_as_the_most_it_takes() -> None:
    screen, _, clock, out = timed(None)
    with screen.bar("simulating", 80, "rigs", WORK, longest_s=200.0) as bar:
        assert out.getvalue() == "simulating (80 rigs, at most 3 min 20 s) ...\n"
        for clock.now_s, done in ((6.0, 8), (10.0, 16)):
            bar(done)
    screen, _, clock, out = timed(None, terminal=True)
    with screen.bar("simulating", 80, "rigs", WORK, longest_s=200.0) as bar:
        for clock.now_s, done in ((6.0, 8), (10.0, 16)):
            bar(done)
    assert "at most 32 s left" in out.getvalue()


def test_what_impacts_end_takes_as_long_as_they_do_and_never_longer_than_it_may() -> None:
    clock = Moment()
    waiting = Waiting(15, 20.0, clock, longest_s=20.0)  # type: ignore[arg-type]
    left = []
    for clock.now_s, done in ((0.5, 0), (1.0, 2), (3.0, 6), (5.0, 6), (19.0, 7)):
        waiting.report(done)
        left.append(waiting.left_s)
    assert left == [19.5, 19.0, pytest.approx(3.75), pytest.approx(6.75), 1.0]
    screen, _, _, out = timed(None)
    with screen.bar("recording", 15, "impacts", longest_s=20.0):
        pass
    assert out.getvalue() == "recording (15 impacts, at most 20 s) ...\n"


def test_a_stage_is_told_with_the_time_left_and_with_what_it_is_a_part_of() -> None:
    screen, _, clock, _ = timed(75.0)
    told: list[tuple[str, float, float, str, float | None]] = []
    screen.stages.append(lambda *stage: told.append(stage))
    with screen.busy("warming up", WORK):
        pass
    screen.part = "point 2 of 27 (about 1 min left)"
    with screen.bar("recording", 60.0) as bar:
        clock.now_s = 20.0
        bar(20.0)
    assert told == [
        ("warming up", 0.0, 0.0, "s", 75.0),
        ("point 2 of 27 (about 1 min left): recording", 0.0, 60.0, "s", 60.0),
        ("point 2 of 27 (about 1 min left): recording", 20.0, 60.0, "s", 40.0),
    ]


def test_of_what_ended_sooner_only_what_was_done_is_kept() -> None:
    screen, paces, clock, _ = timed(75.0)
    with screen.bar("simulating", 80, "rigs", WORK, longest_s=50.0) as bar:
        clock.now_s = 10.0
        bar(20)
    assert paces.kept == [(Work(WORK.kind, WORK.units / 4), 10.0)]
