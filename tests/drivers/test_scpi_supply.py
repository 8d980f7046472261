"""The DC supply's driver against the emulated N6954A: at a time of its own, and over its wires."""

from __future__ import annotations

import math
import multiprocessing
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

import pytest

from daq.errors import InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.protocols.speed_drive import MotorOutput, SpeedDrive
from drivers.scpi.emulator.keysight_n6900 import LSB_V, EmulatedN6900
from drivers.scpi.emulator.process import SourceSetup, start_dc_supply
from drivers.scpi.supply import ScpiSupply
from drivers.scpi.supply_settings import MEASURED_V, SupplySettings, Trouble
from tests.drivers.scripted import ScriptedInstrument

RPM_PER_VOLT, HIGHEST_RPM, RAMP_S = 5.0, 350.0, 0.5
SETTINGS = SupplySettings(RPM_PER_VOLT, HIGHEST_RPM, 3.0, ramp_s=RAMP_S, timeout_s=0.5)


class InPlace:
    """An emulated supply behind sockets of the test's own, at a time of its own."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.outputs = list[MotorOutput]()
        self.instrument = EmulatedN6900(self.outputs.append, lambda: self.now_s)
        self.wrong: dict[str, bytes] = {}

    def __call__(self, line: str) -> bytes:
        if line in self.wrong:
            return self.wrong[line]
        answer = self.instrument.run(line)
        return b"" if answer is None else answer.encode() + b"\n"


@pytest.fixture
def supply() -> Iterator[tuple[ScpiSupply, InPlace, ScriptedInstrument]]:
    behind = InPlace()
    with ScriptedInstrument(behind) as server:
        driver = ScpiSupply(SETTINGS.at(server.resource))
        driver.open()
        yield driver, behind, server
        driver.close()


@contextmanager
def another(behind: InPlace, settings: SupplySettings = SETTINGS) -> Iterator[ScpiSupply]:
    """Another connection to the same supply."""
    with ScriptedInstrument(behind) as server:
        driver = ScpiSupply(settings.at(server.resource))
        yield driver
        driver.close()


Supply = tuple[ScpiSupply, InPlace, ScriptedInstrument]


def started(driver: ScpiSupply, rpm: float = 200.0) -> float:
    kept = driver.arm(rpm)
    driver.start()
    return kept


def looked(driver: ScpiSupply, count: int = 16) -> None:
    for _ in range(count):
        driver.check()


def test_it_is_armed_at_rest_and_comes_up_by_its_own_slew_rate(supply: Supply) -> None:
    driver, behind, server = supply
    drive: SpeedDrive = driver
    assert drive.ramp_s(0.0, HIGHEST_RPM) == RAMP_S
    assert driver.identity.startswith("Keysight Technologies,N6954A,")
    assert driver.arm(201.03) == pytest.approx(201.05)  # 0.01 V are 0.05 rpm
    assert behind.outputs == []
    told = server.lines
    assert (
        told.index("OUTP OFF") < told.index("VOLT 0") < told.index("OUTP:PROT:CLE") < told.index("VOLT 40.21")
    )
    assert {"CURR 3", "VOLT:PROT 77", "VOLT:SLEW 140"} <= set(told)
    driver.start()
    told = server.lines
    assert told.index("OUTP:PROT:WDOG:DEL 2") < told.index("OUTP:PROT:WDOG ON") < told.index("OUTP ON")
    (output,) = behind.outputs
    assert (output.on, output.level, output.slope_per_s) == (True, 0.0, pytest.approx(140.0))
    assert output.target == pytest.approx(40.21, abs=LSB_V)


def test_its_state_is_what_it_measures(supply: Supply) -> None:
    driver, behind, _ = supply
    started(driver)
    behind.now_s += 0.1
    state = driver.read()
    assert (state.running, state.set_rpm) == (True, pytest.approx(200.0))
    assert state.output_voltage_v == pytest.approx(14.0)
    assert (state.speed_rpm, state.output_current_a) == (pytest.approx(70.0), pytest.approx(0.8))
    behind.now_s += 1.0
    looked(driver, 4)
    assert driver.state is not None
    assert driver.state.speed_rpm == pytest.approx(200.0, abs=LSB_V * RPM_PER_VOLT)


def test_it_is_at_an_order_while_it_answers_and_not_while_it_hangs(supply: Supply) -> None:
    """Who guards a run gives an order as long as that; one that hangs is no order that goes on."""
    driver, behind, _ = supply
    began_s = time.monotonic()
    started(driver)
    assert driver.busy or time.monotonic() - began_s > 0.1
    behind.wrong[MEASURED_V] = b""
    with pytest.raises(InstrumentSilent):
        driver.read()
    assert not driver.busy


def test_a_look_is_one_exchange_and_the_output_is_looked_at_every_fourth_time(supply: Supply) -> None:
    """The sequence may look at nothing else for 0.6 s, and an answer may take 0.5 s."""
    driver, _, server = supply
    started(driver)
    before = len(server.lines)
    looked(driver)
    asked = server.lines[before:]
    assert len(asked) == 16
    assert asked[::4] == ["OUTP?"] * 4
    assert asked[2::4] == ["STAT:QUES:COND?"] * 4
    assert set(asked[3::4]) == {"VOLT?", "CURR?", "OUTP:PROT:WDOG?", "STAT:OPER:COND?"}


def test_off_is_off_at_any_time_and_takes_the_watchdog_with_it(supply: Supply) -> None:
    driver, behind, server = supply
    driver.off()
    started(driver)
    driver.stop(lambda: 200.0)
    assert not behind.outputs[-1].on
    looked(driver)  # an answer comes after all that was sent before
    off = len(server.lines) - 1 - server.lines[::-1].index("OUTP OFF")
    assert server.lines[off + 1 : off + 3] == ["OUTP?", "OUTP:PROT:WDOG OFF"]
    driver.cut()
    driver.close()
    driver.off()


def test_what_was_switched_off_by_another_thread_neither_starts_nor_changes(supply: Supply) -> None:
    driver, behind, _ = supply
    driver.arm(200.0)
    driver.cut()
    with pytest.raises(InstrumentRefused, match="switched off while it was to start"):
        driver.start()
    assert not any(output.on for output in behind.outputs)
    with pytest.raises(InstrumentRefused, match="it was switched off"):
        driver.set_speed(100.0)
    assert started(driver, 100.0) == pytest.approx(100.0)  # a run of its own begins by arming
    assert behind.outputs[-1].on


@pytest.mark.parametrize("at", ["OUTP:PROT:WDOG:DEL 2", "OUTP:PROT:WDOG ON", "OUTP ON"])
def test_a_start_that_took_too_long_before_it_was_sent_turns_nothing_on(
    supply: Supply, monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    """As of a process that was stopped for a while, at whichever of its steps."""
    driver, behind, server = supply
    driver.arm(200.0)
    write, now_s, slept_s = driver._link.write, time.monotonic, [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s() + slept_s[0])

    def frozen(command: str, until_s: float = math.inf) -> None:
        slept_s[0] += command == at
        write(command, until_s)

    monkeypatch.setattr(driver._link, "write", frozen)
    with pytest.raises(InstrumentRefused, match=r"s too late; it was not sent"):
        driver.start()
    assert "OUTP ON" not in server.lines
    assert not any(output.on for output in behind.outputs)


@pytest.mark.parametrize("rpm", [350.1, -1.0, math.nan, math.inf])
def test_nothing_is_sent_beyond_the_bench(supply: Supply, rpm: float) -> None:
    driver, _, server = supply
    before = len(server.lines)
    for order in (driver.arm, driver.set_speed):
        with pytest.raises(InstrumentRefused, match=r"is outside 0 to 350 rpm; nothing was sent") as caught:
            order(rpm)
        assert caught.value.code == "limit"
    assert len(server.lines) == before


def test_a_silent_driver_is_switched_off_by_the_supply_itself(supply: Supply) -> None:
    driver, behind, _ = supply
    started(driver)
    behind.now_s += 1.9
    driver.check()
    behind.now_s += 1.9
    behind.instrument.look()
    assert behind.outputs[-1].on
    behind.now_s += 0.2
    behind.instrument.look()
    assert not behind.outputs[-1].on
    with pytest.raises(InstrumentRefused, match="switched its output off: watchdog"):
        looked(driver)
    driver.off()
    started(driver)  # what a watchdog has latched is no cause that a person must see
    assert behind.outputs[-1].on


def test_a_supply_that_trips_ends_the_run_and_waits_for_a_person(supply: Supply) -> None:
    driver, behind, _ = supply
    started(driver)
    behind.instrument.trip(Trouble.OVER_TEMPERATURE)
    with pytest.raises(InstrumentRefused, match=r"off: over temperature\. .*by hand") as caught:
        looked(driver)
    assert caught.value.code == "tripped"
    driver.off()
    with another(behind) as second, pytest.raises(InstrumentRefused, match="off: over temperature"):
        second.open()


def test_a_volt_too_much_at_its_panel_is_seen_and_over_its_protection_it_is_off(supply: Supply) -> None:
    driver, behind, _ = supply
    started(driver)
    behind.instrument.run("VOLT 45")
    with pytest.raises(InstrumentRefused, match=r"VOLT is \+4\.49.*E\+01, which it was not told"):
        looked(driver)
    behind.instrument.run("VOLT 78")
    assert not behind.outputs[-1].on


def test_a_motor_that_takes_all_that_it_may_is_told_of_once(supply: Supply) -> None:
    driver, behind, _ = supply
    started(driver)
    driver.take_notices()
    behind.instrument.run("CURR 0.5")
    driver._kept.pop("CURR")
    looked(driver, 32)
    (notice,) = driver.take_notices()
    assert (notice.level, notice.code) == ("warning", "supply.current_limit")


def test_a_bench_beyond_the_model_is_refused(supply: Supply) -> None:
    _, behind, _ = supply
    for settings, match in (
        (SupplySettings(2.0, 300.0, 3.0), r"gives 81\.6 V, and the bench asks for 150 V"),
        (SupplySettings(5.0, 300.0, 20.0), r"gives 12\.75 A, and the bench asks for 20 A"),
    ):
        with another(behind, settings) as second, pytest.raises(InstrumentRefused, match=match):
            second.open()
    assert behind.outputs == []


@pytest.mark.parametrize(
    ("line", "answer", "match"),
    [
        ("MEAS:VOLT?", b"volts\n", r"MEAS:VOLT\? is answered with what is not a number: 'volts'"),
        ("STAT:QUES:COND?", b"+9.9E+37\n", "no register of 16 bits"),
        ("STAT:OPER:COND?", b"-1\n", "no register of 16 bits"),
    ],
)
def test_an_answer_that_is_none_is_not_believed(supply: Supply, line: str, answer: bytes, match: str) -> None:
    driver, behind, _ = supply
    started(driver)
    behind.wrong[line] = answer
    with pytest.raises(InstrumentRefused, match=match):
        looked(driver)


def test_one_that_drives_for_somebody_else_is_left_as_it_is(supply: Supply) -> None:
    driver, behind, _ = supply
    started(driver)
    before = len(behind.outputs)
    with another(behind) as second, pytest.raises(InstrumentRefused, match="its output is on already"):
        second.open()
    assert len(behind.outputs) == before


def test_a_spare_connection_turns_off_before_anything_else(supply: Supply) -> None:
    driver, behind, _ = supply
    started(driver)
    with ScriptedInstrument(behind) as server:
        spare = ScpiSupply(SETTINGS.at(server.resource), off_first=True)
        spare.open()
        assert [line for line in server.lines if line] == ["OUTP OFF"]
        spare.off()
        spare.close()
    assert not behind.outputs[-1].on


@pytest.fixture(scope="module")
def process() -> Iterator[tuple[tuple[str, ...], Connection]]:
    receiver, sender = multiprocessing.get_context("spawn").Pipe(duplex=False)
    with start_dc_supply(sender) as emulator, receiver:
        sender.close()
        yield tuple(emulator.addresses), receiver


@pytest.mark.parametrize("way", [0, 1], ids=["TCP", "pty"])
def test_over_its_wires(process: tuple[tuple[str, ...], Connection], way: int) -> None:
    addresses, outputs = process
    driver = ScpiSupply(SETTINGS.at(addresses[way]))
    assert driver.longest_stop_s == (0.0, 1.0)[way]
    driver.open()
    try:
        started(driver)
        looked(driver)
    finally:
        driver.off()
        driver.close()
    heard = [outputs.recv(), outputs.recv()]
    assert [output.on for output in heard] == [True, False]
    assert not outputs.poll(0)


def test_another_make_is_refused() -> None:
    with start_dc_supply(setup=SourceSetup("Another Maker,Model 1,0,1.0")) as emulator:
        driver = ScpiSupply(SETTINGS.at(emulator.address))
        with pytest.raises(InstrumentAbsent, match="which is no supply of the N6900 or N7900 series"):
            driver.open()


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        ("SOUR:VOLT:LEV:IMM:AMPL 12.5;:VOLT?", LSB_V * round(12.5 / LSB_V)),
        ("voltage:level 1;slew 4;:volt:slew?", 4.0),
        ("CURR 500 MA;CURR?", 0.5),
        ("VOLT? MAX", 81.6),
        ("CURR? MIN", 0.0),
        ("OUTP:PROT:WDOG:DEL 3;DEL?", 3.0),
    ],
)
def test_its_language(message: str, answer: float) -> None:
    instrument = EmulatedN6900(lambda output: None, lambda: 0.0)
    found: Callable[[str], str | None] = instrument.run
    assert float(found(message) or "nan") == pytest.approx(answer, rel=1e-6)
    assert instrument.run("SYST:ERR?") == '+0,"No error"'


@pytest.mark.parametrize(
    ("message", "code"), [("VOLT 90", -222), ("CURR -1", -222), ("VOLT", -109), ("WHAT", -113)]
)
def test_what_it_refuses_changes_nothing(message: str, code: int) -> None:
    instrument = EmulatedN6900(lambda output: None, lambda: 0.0)
    instrument.run(message)
    assert (instrument.run("SYST:ERR?") or "").startswith(f"{code},")
    assert float(instrument.run("VOLT?") or "nan") == 0.0
