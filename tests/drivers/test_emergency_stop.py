"""The emergency stop's line: read on the card or the inverter, seen in time, never taken for healthy."""

from __future__ import annotations

import itertools
import pickle
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pymodbus.constants import ExcCodes

from daq.clock import SystemClock
from daq.errors import DeviceLost, EmergencyStop, InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers import lock as locks
from drivers.lock import Latch
from drivers.mitsubishi_fr.emulator.drive import (
    NO_TERMINAL,
    DriveFaults,
    EmulatedDrive,
    FreeMotor,
    InverterSetup,
)
from drivers.mitsubishi_fr.emulator.line_faults import LineFaults
from drivers.mitsubishi_fr.emulator.process import matching_setup
from drivers.mitsubishi_fr.emulator.server import InverterServer
from drivers.mitsubishi_fr.registers import (
    INPUT_TERMINALS,
    PARAMETERS,
    RUNNING_FREQUENCY,
    TERMINAL_FUNCTIONS,
    Terminal,
)
from drivers.mitsubishi_fr.settings import InverterMisconfigured
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.channels import CardSettings
from drivers.ni_daq.emulator.acquisition import DriveInbox
from drivers.ni_daq.emulator.servicer import CardServer, CardServicer
from drivers.ni_daq.stop_line import CardLine
from drivers.protocols.emergency_stop import LOOK_S, SILENCE_S, LineWatch, StopLine, refuse_open
from drivers.rehearsal import rehearsed
from tests.drivers.conftest import FORCE, WIRING, card_settings
from tests.drivers.fr_bench import HZ, SETTINGS, Bench, latched, on_bench
from tests.drivers.plants import SinePlant
from tests.end_to_end.command import await_true

LINE = "cDAQ1Mod4/port0/line0"
CLOSED, OPENED = {LINE: True}, {LINE: False}
WITHIN_S = 0.15
"""From the line to the off: as quick as a limit."""


def test_an_error_that_tells_of_it_goes_to_another_process() -> None:
    seen = EmergencyStop(LINE, "its line is open", 12.5)
    again = pickle.loads(pickle.dumps(seen))  # noqa: S301 - our own
    assert (str(again), again.at_s) == (str(seen), 12.5)
    assert "that nobody is in danger" in str(seen)
    unread = EmergencyStop.unread(LINE, "its line gives no reading", 1.5, "its cable")
    assert str(pickle.loads(pickle.dumps(unread))) == str(unread)  # noqa: S301 - our own


@pytest.mark.parametrize("contact", ["normally closed", "normally open"])
def test_a_contact_says_what_an_open_line_is(contact: str) -> None:
    line = StopLine(LINE, contact)  # type: ignore[arg-type]
    line.heed(contact == "normally closed", "here")
    with pytest.raises(EmergencyStop, match="its line is open"):
        line.heed(contact != "normally closed", "here")


@pytest.fixture
def servicer() -> Iterator[tuple[CardServicer, CardSettings]]:
    """An emulated card, and the settings by which it is reached."""
    servicer = CardServicer(SinePlant(), replace(WIRING, lines=CLOSED), DriveInbox(), SystemClock())
    server = CardServer(servicer)
    yield servicer, replace(card_settings(server.open(), FORCE), stop_line=StopLine(LINE))
    server.close()


def test_a_digital_input_of_the_card_is_read_beside_its_samples(
    servicer: tuple[CardServicer, CardSettings],
) -> None:
    emulator, settings = servicer
    card, line = NiDaqCard(settings), CardLine(settings)
    card.open()
    try:
        card.start()
        line.open()
        line.heed()
        with pytest.raises(InstrumentRefused, match=r"-50103.*in use"):
            refuse_open(lambda: CardLine(settings))
        emulator.put_lines(OPENED)
        with pytest.raises(
            EmergencyStop, match=f"emergency stop at {LINE} of {settings.grpc}: its line is open"
        ):
            line.heed()
        assert np.isfinite(card.read(100).values).all()
        emulator.put_lines({})
        with pytest.raises(DeviceLost, match="the module does not answer"):
            line.heed()
    finally:
        line.close()
        card.close()


def test_a_line_that_the_card_lacks_is_told(servicer: tuple[CardServicer, CardSettings]) -> None:
    settings = replace(servicer[1], stop_line=StopLine("cDAQ1Mod4/port0/line7"))
    with pytest.raises(InstrumentRefused, match="there is no digital line cDAQ1Mod4/port0/line7"):
        refuse_open(lambda: CardLine(settings))


def test_what_a_dead_client_left_is_free_again(servicer: tuple[CardServicer, CardSettings]) -> None:
    _, settings = servicer
    died, line, next_one = NiDaqCard(settings), CardLine(settings), NiDaqCard(settings)
    died.open()
    died.start()
    line.open()
    next_one.open()
    with pytest.raises(InstrumentRefused, match="-50103"):
        next_one.start()
    next_one.close()
    for channel in (died._grpc_channel, line._channel):  # without a word, as the kernel closes it
        channel.close()

    def freed() -> bool:
        try:
            next_one.open()
            next_one.start()
        except InstrumentRefused:
            next_one.close()
            return False
        return True

    def line_freed() -> bool:
        try:
            refuse_open(lambda: CardLine(settings))
        except InstrumentRefused:
            return False
        return True

    await_true("free", freed, 5.0)
    assert next_one.read(100).values.shape == (1, 100)
    await_true("the line free", line_freed, 5.0)  # of another connection, which may be seen to end later
    next_one.close()


class ScriptedLine:
    """Is read as `error` says; hangs where it is told to."""

    address = "here"

    def __init__(self) -> None:
        self.error: Exception | None = None
        self.goes_on = threading.Event()
        self.goes_on.set()

    def open(self) -> None: ...

    def heed(self) -> None:
        self.goes_on.wait()
        if self.error is not None:
            raise self.error

    def after_a_fifth(self) -> None:
        """As a call whose deadline passes."""
        time.sleep(0.2)
        ScriptedLine.heed(self)

    def close(self) -> None:
        self.goes_on.set()


def seen_within(watch: LineWatch, seconds: float) -> EmergencyStop | None:
    end_s = time.monotonic() + seconds
    while (seen := watch.look()) is None and time.monotonic() < end_s:
        time.sleep(LOOK_S / 4)
    return seen


@pytest.mark.parametrize(
    ("error", "what"),
    [
        (EmergencyStop("here", "its line is open", 1.0), "its line is open"),
        (
            DeviceLost("emergency stop", "here", "the module is gone"),
            "its line cannot be read: the module is gone",
        ),
    ],
)
def test_what_was_seen_once_stays_seen(error: Exception, what: str) -> None:
    line = ScriptedLine()
    with LineWatch(lambda: line, SystemClock()) as watch:
        assert seen_within(watch, 0.7) is None
        line.error = error
        seen = seen_within(watch, 1.0)
        line.error = None
        time.sleep(3 * LOOK_S)
        assert watch.look() is seen
    assert seen is not None
    assert seen.what == what
    assert ("free it where it was pressed" in str(seen)) == (what == "its line is open")


def test_an_answer_that_is_late_is_waited_for_half_a_second() -> None:
    line, late = ScriptedLine(), InstrumentSilent("emergency stop", "here", "no answer within the deadline")
    line.error = late
    with LineWatch(lambda: line, SystemClock()) as watch:
        line.error = None
        assert seen_within(watch, 0.5) is None
        line.heed = line.after_a_fifth  # type: ignore[method-assign]
        line.error = late
        assert seen_within(watch, SILENCE_S * 0.8) is None
        began_s = time.monotonic()
        seen = seen_within(watch, 1.5)
        assert time.monotonic() - began_s < SILENCE_S
    assert seen is not None
    assert "an unread line counts as open" in str(seen)


def test_a_line_that_is_often_read_late_counts_as_open() -> None:
    line, late = ScriptedLine(), InstrumentSilent("emergency stop", "here", "no answer within the deadline")
    with LineWatch(lambda: line, SystemClock()) as watch:
        began_s = time.monotonic()
        while (seen := watch.look()) is None and time.monotonic() < began_s + 5.0:
            line.error = None if line.error else late  # every other reading is in time
            time.sleep(LOOK_S)
    assert seen is not None
    assert "its line cannot be read: no answer within the deadline" in seen.what


@pytest.mark.parametrize("in_time", [10, 20])
def test_a_line_that_is_read_late_now_and_then_is_not_for_long(in_time: int) -> None:
    line, late = ScriptedLine(), InstrumentSilent("emergency stop", "here", "no answer within the deadline")
    readings = itertools.count()

    def heed() -> None:
        if next(readings) % (in_time + 1) == in_time:
            time.sleep(0.1)
            raise late

    line.heed = heed  # type: ignore[method-assign]
    with LineWatch(lambda: line, SystemClock()) as watch:
        seen = seen_within(watch, 10.0)
    assert seen is not None
    assert "its line cannot be read" in seen.what
    assert next(readings) <= 4 * (in_time + 1) + 1


def test_a_press_between_late_answers_is_seen() -> None:
    line, late = ScriptedLine(), InstrumentSilent("emergency stop", "here", "no answer within the deadline")
    with LineWatch(lambda: line, SystemClock()) as watch:
        line.error = late
        assert seen_within(watch, 2 * LOOK_S) is None
        line.error = EmergencyStop("here", "its line is open", 1.0)
        seen = seen_within(watch, WITHIN_S)
    assert seen is not None
    assert seen.what == "its line is open"


def test_a_reading_that_does_not_come_counts_as_open() -> None:
    line = ScriptedLine()
    with LineWatch(lambda: line, SystemClock()) as watch:
        line.goes_on.clear()
        seen = seen_within(watch, 1.5)
    assert seen is not None
    assert seen.what == "its line gives no reading"
    assert "whether it was pressed: an unread line counts as open. If not, the card that reads it" in str(
        seen
    )


def test_one_that_cannot_be_reached_counts_as_open() -> None:
    settings = CardSettings(grpc="127.0.0.1:1", stop_line=StopLine(LINE))
    with LineWatch(lambda: CardLine(settings), SystemClock()) as watch:
        seen = watch.look()
    assert seen is not None
    assert "its line cannot be read: nobody answers" in seen.what
    assert str(seen).startswith(f"emergency stop at {LINE} of 127.0.0.1:1: ")
    assert "free it where it was pressed" not in str(seen)
    with pytest.raises(InstrumentAbsent, match="nobody answers"):
        refuse_open(lambda: CardLine(settings))


def test_a_latch_outlives_its_program_until_it_is_lifted(
    tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locks, "FOLDERS", (str(tmp_path),))
    assert Latch("generator", "here").told() == ""
    Latch("generator", "here").set("pressed")
    assert (Latch("generator", "here").told(), Latch("generator", "there").told()) == ("pressed", "")
    Latch("generator", "here").set("")
    assert Latch("generator", "here").told() == ""


def test_a_latch_that_cannot_be_kept_or_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "FOLDERS", (str(tmp_path),))
    latch = Latch("generator", "here")
    latch.set("")
    (file,) = tmp_path.iterdir()
    file.unlink()
    file.mkdir()
    with pytest.raises(InstrumentRefused, match="the latch of its emergency stop cannot be set"):
        latch.set("pressed")
    with pytest.raises(InstrumentRefused, match=r"generator at here: .* cannot be read"):
        latch.told()


def test_nobody_reads_a_line_any_more_once_it_is_left() -> None:
    line = ScriptedLine()
    with LineWatch(lambda: line, SystemClock()):
        pass
    assert "emergency stop" not in [thread.name for thread in threading.enumerate()]


class SteppedClock:
    """Shows what the test sets; whoever sleeps by it waits for the test."""

    def __init__(self) -> None:
        self.now_s, self.goes_on = 0.0, threading.Event()

    def unix_ns(self) -> int:
        return round(self.now_s * 1e9)

    def monotonic_s(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.goes_on.wait()


def test_looks_count_and_not_seconds() -> None:
    """Where the whole machine stood still, nobody could read the line."""
    clock = SteppedClock()
    with LineWatch(ScriptedLine, clock) as watch:
        clock.now_s = 60.0
        assert watch.look() is None
        looks = 1
        while (seen := watch.look()) is None:
            clock.now_s, looks = clock.now_s + LOOK_S, looks + 1
        clock.goes_on.set()
    assert 0.5 <= looks * LOOK_S < 0.6
    assert seen.at_s == clock.now_s


WATCHED = replace(SETTINGS, stop_line=StopLine("inverter/RH"))
HEALTHY = matching_setup(WATCHED, 1.0).faults
PRESSED = DriveFaults()


def test_an_inverter_whose_terminal_is_open_is_refused_and_nothing_is_written() -> None:
    async def check_in(bench: Bench) -> list[tuple[int, int]]:
        with pytest.raises(EmergencyStop, match="emergency stop at inverter/RH of nowhere: its line is open"):
            await bench.poller.check_in()
        return bench.line.writes()

    assert on_bench(check_in, settings=WATCHED, faults=PRESSED) == []


@pytest.mark.parametrize(
    ("terminal", "function", "says"),
    [
        ("STF", 60, r"60 \(run forward\)"),
        ("STR", 61, r"61 \(run reverse\)"),
        ("RH", 5, r"5 \(jog\)"),
        ("RL", 14, "14"),
    ],
)
def test_a_line_on_a_terminal_whose_function_moves_the_motor_is_refused(
    terminal: str, function: int, says: str
) -> None:
    async def check_in(bench: Bench) -> list[tuple[int, int]]:
        with pytest.raises(
            InverterMisconfigured, match=rf"{terminal} terminal function selection = {says}: 9999 \(none\)"
        ):
            await bench.poller.check_in()
        return bench.line.writes()

    number = TERMINAL_FUNCTIONS[terminal].number - PARAMETERS
    watched = replace(SETTINGS, stop_line=StopLine(f"inverter/{terminal}"))
    assert on_bench(check_in, settings=watched, parameters={number: function}) == []


@pytest.mark.parametrize("function", [9999, 65535, 7, 10, 24])
def test_one_that_moves_nothing_may_carry_the_line(function: int) -> None:
    async def check_in(bench: Bench) -> None:
        await bench.poller.check_in()

    on_bench(check_in, settings=WATCHED, faults=HEALTHY, parameters={182: function})


def test_a_line_stays_open_while_the_emulated_drive_trips_and_forgets() -> None:
    """What goes wrong later takes nothing back."""
    drive = EmulatedDrive(InverterSetup(faults=HEALTHY), FreeMotor(), lambda: 0.0)
    server = InverterServer(drive, 1, LineFaults())
    server.open()
    server.drive.put_faults(PRESSED)
    for text in (
        "refuses:count=2",
        "forgets:register=40014",
        "stuck",
        "trips:code=48",
        "refuses:register=40009",
    ):
        server.befall(rehearsed(f"inverter.{text}"))
        server.drive.access(40201, 1, None)  # used up what the first refuses, once each
    faults = server.drive.faults
    assert (faults.terminals, faults.stuck, faults.not_obeyed) == (NO_TERMINAL, True, frozenset({40014}))
    assert faults.exceptions == {40201: (2, 0), 40009: (2, 1)}
    assert server.drive.access(40501, 1, None) == [48]
    for text in ("cut:share=0.1", "flip:share=0.2"):
        server.befall(rehearsed(f"inverter.{text}"))
    assert [(each.share, each.kinds) for each in server.disturbance.faults[1:]] == [
        (0.1, ("cut",)),
        (0.2, ("flip",)),
    ]
    server.close()


def test_one_that_has_no_such_register_is_refused() -> None:
    async def check_in(bench: Bench) -> None:
        with pytest.raises(InstrumentRefused, match=r"exception 02 .* at 40215 \(input terminal status"):
            await bench.poller.check_in()

    lacks = replace(HEALTHY, exceptions={INPUT_TERMINALS.number: (ExcCodes.ILLEGAL_ADDRESS, 9)})
    on_bench(check_in, settings=WATCHED, faults=lacks)


@pytest.mark.parametrize("phase_s", np.linspace(0.0, 0.1, 11))
def test_run_is_withdrawn_in_time_wherever_a_poll_is(phase_s: float) -> None:
    """At 19200 baud, on a line that carries nothing but polls."""

    async def press(bench: Bench) -> tuple[float, float]:
        await bench.run_at(HZ)
        await bench.wait(phase_s)
        pressed_s = bench.loop.time()
        bench.drive.put_faults(PRESSED)
        error = await latched(bench, 0.5)
        await bench.wait(0.1)
        bench.drive.put_faults(HEALTHY)
        await bench.wait(1.0)
        assert bench.poller.error is error  # for good
        assert isinstance(error, EmergencyStop)
        assert bench.load.at(bench.loop.time()) == 0.0
        return pressed_s, bench.withdrawn_s()

    pressed_s, withdrawn_s = on_bench(press, settings=WATCHED, faults=HEALTHY)
    assert withdrawn_s - pressed_s < WITHIN_S


@pytest.mark.parametrize("phase_s", np.linspace(0.0, 0.1, 6))
def test_run_is_withdrawn_in_time_on_the_ramp_of_another_error_too(phase_s: float) -> None:
    async def press(bench: Bench) -> tuple[float, float]:
        await bench.run_at(HZ)
        bench.drive.access(RUNNING_FREQUENCY.number, 1, [900])
        assert not isinstance(await latched(bench, 0.5), EmergencyStop)
        await bench.wait(phase_s)
        pressed_s = bench.loop.time()
        bench.drive.put_faults(PRESSED)
        await bench.wait(1.0)
        bench.drive.put_faults(HEALTHY)
        await bench.wait(7.0)
        assert isinstance(bench.poller.error, EmergencyStop)
        assert bench.load.at(bench.loop.time()) == 0.0
        return pressed_s, bench.withdrawn_s()

    slow = {7: 600, 8: 600}  # 60 s for its 60 Hz
    pressed_s, withdrawn_s = on_bench(press, settings=WATCHED, faults=HEALTHY, parameters=slow)
    assert withdrawn_s - pressed_s < WITHIN_S


def test_a_drive_that_falls_silent_after_another_error_is_no_emergency_stop() -> None:
    async def silence(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.drive.access(RUNNING_FREQUENCY.number, 1, [900])
        first = await latched(bench, 0.5)
        bench.line.mute = True
        await bench.wait(3.0)
        assert bench.poller.error is first

    on_bench(silence, settings=WATCHED, faults=HEALTHY)


def test_a_normally_open_contact_and_another_terminal() -> None:
    async def check_in(bench: Bench) -> None:
        await bench.poller.check_in()
        bench.drive.put_faults(DriveFaults(terminals=Terminal.STR))
        assert isinstance(await latched(bench, 0.5), EmergencyStop)

    line = StopLine("inverter/STR", "normally open")
    on_bench(check_in, settings=replace(SETTINGS, stop_line=line), faults=DriveFaults(terminals=Terminal.RH))


def test_a_line_that_falls_silent_counts_as_open() -> None:
    async def silence(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.line.mute = True
        seen = await latched(bench, 2.0)
        assert isinstance(seen, EmergencyStop)
        assert "its line cannot be read: no answer to" in seen.what
        assert "whether it was pressed: an unread line counts as open. If not, that it is switched on" in str(
            seen
        )

    on_bench(silence, settings=WATCHED, faults=HEALTHY)
