"""The whole driver over real wires: to the emulator in its process, and to a device that we did not write."""

from __future__ import annotations

import asyncio
import math
import multiprocessing
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection

import psutil
import pytest

from daq.clock import SystemClock
from daq.errors import DeviceLost, InstrumentRefused, InstrumentSilent
from drivers.emulator_process import EmulatedInstrument
from drivers.mitsubishi_fr.emulator.drive import PARAMETERS, InverterSetup
from drivers.mitsubishi_fr.emulator.line_faults import KINDS, LineFaults
from drivers.mitsubishi_fr.emulator.process import InverterWiring, start_inverter
from drivers.mitsubishi_fr.frames import READ, Request
from drivers.mitsubishi_fr.inverter import FrInverter, _Open
from drivers.mitsubishi_fr.line import SerialLine
from drivers.mitsubishi_fr.registers import FAULTS, MONITOR_BLOCK, RUNNING_FREQUENCY, STATUS_BLOCK
from drivers.mitsubishi_fr.settings import InverterMisconfigured, InverterSettings
from drivers.protocols.instrument import Notices
from drivers.protocols.speed_drive import MotorOutput, SpeedDrive
from drivers.rehearsal import rehearsed
from tests.drivers.fr_peer import PlainServer
from tests.end_to_end.command import await_true

WATCHDOG_S = 2.0
FAST = {7: 5, 8: 5, 122: 20}  # 60 Hz in 0.5 s; the longest watchdog, so that a busy machine trips nothing
DEADLINE_S = 10.0
CHILD = """
import sys, time
from drivers.mitsubishi_fr.inverter import FrInverter
from drivers.mitsubishi_fr.settings import InverterSettings
inverter = FrInverter(InverterSettings(30.0, 300.0, port=sys.argv[1], unattended_s=1e3))
inverter.open()
inverter.set_speed(200.0)
inverter.start()
print("runs", flush=True)
time.sleep(1e3)
"""


def settings_for(port: str, parity: str = "E") -> InverterSettings:
    # Answers may take longer than a drive's would, on a machine that is busy with something else.
    return InverterSettings(30.0, 300.0, port=port, parity=parity, answer_s=0.5, silent_s=2.5)


class Ends:
    """Our ends of the connections of an emulated inverter."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.outputs, theirs_outputs = context.Pipe(duplex=False)
        theirs_currents, self.currents = context.Pipe(duplex=False)
        theirs_rehearsal, self.rehearsal = context.Pipe(duplex=False)
        self.theirs = (theirs_outputs, theirs_currents, theirs_rehearsal)
        self.wiring = InverterWiring(*self.theirs)

    def await_output(self, wanted: Callable[[MotorOutput], bool]) -> MotorOutput:
        """Return the next output that is as wanted."""
        deadline_s = time.monotonic() + DEADLINE_S
        while self.outputs.poll(max(deadline_s - time.monotonic(), 0.0)):
            output = self.outputs.recv()
            assert isinstance(output, MotorOutput)
            if wanted(output):
                return output
        raise AssertionError("no such output")


@contextmanager
def emulated(setup: InverterSetup | None = None) -> Iterator[tuple[EmulatedInstrument, Ends]]:
    ends = Ends()
    ours: tuple[Connection, ...] = (ends.outputs, ends.currents, ends.rehearsal)
    try:
        with start_inverter(ends.wiring, setup or InverterSetup(FAST)) as emulator:
            for connection in ends.theirs:
                connection.close()
            yield emulator, ends
    finally:
        for connection in ours:
            connection.close()


def check_until_it_raises(inverter: FrInverter) -> None:
    deadline_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline_s:
        inverter.check()
        time.sleep(0.01)


@contextmanager
def opened(settings: InverterSettings) -> Iterator[FrInverter]:
    inverter = FrInverter(settings)
    inverter.open()
    try:
        yield inverter
    finally:
        inverter.close()


@pytest.fixture(scope="module")
def bench() -> Iterator[tuple[EmulatedInstrument, Ends]]:
    with emulated() as running:
        yield running


def test_it_turns_the_crank_and_stops_it(bench: tuple[EmulatedInstrument, Ends]) -> None:
    emulator, ends = bench
    with opened(settings_for(emulator.address)) as inverter:
        assert "station 1, ramps down after 2 s of silence" in inverter.identity
        assert any("Pr.1 maximum frequency is 120 Hz" in warning for warning in inverter.warnings)
        assert inverter.set_speed(200.0) == pytest.approx(200.1, abs=1e-9)
        inverter.start()
        output = ends.await_output(lambda output: output.target > 0.0)
        assert output.target == pytest.approx(6.67, abs=1e-9)
        assert output.slope_per_s == pytest.approx(120.0, abs=1e-9)
        while (state := inverter.read()).output_frequency_hz != 6.67:
            assert time.monotonic() < output.settled_s + DEADLINE_S
        assert (state.running, state.fault) == (True, "")
        assert state.set_rpm == pytest.approx(200.1, abs=1e-9)
        inverter.check()
        inverter.stop()
        assert inverter.read().speed_rpm == 0.0
        inverter.stop()  # as on every way out of a run: done again, told once
        assert ends.await_output(lambda output: output.target == 0.0).on
        assert inverter.health is not None
        assert inverter.health.asked > 10
    told = inverter.take_notices()
    assert [notice.code for notice in told] == [
        "inverter.set",
        "inverter.run",
        "inverter.ramp",
        "inverter.off",
    ]
    assert told[0].text == "set to 6.67 Hz (200.1 rpm)"


def test_a_stop_that_its_caller_cannot_wait_for_goes_on(
    bench: tuple[EmulatedInstrument, Ends], monkeypatch: pytest.MonkeyPatch
) -> None:
    emulator, ends = bench
    with opened(settings_for(emulator.address)) as inverter:
        inverter.set_speed(200.0)
        inverter.start()
        ends.await_output(lambda output: output.target > 0.0)
        # A shaft that seems to turn on holds the stop up for one and a half ramps, 0.5 s at least.
        with monkeypatch.context() as patched:
            patched.setattr(_Open, "longest_stop_s", 0.1)
            with pytest.raises(InstrumentSilent, match=r"its stop, which goes on, has not ended within 0\.1"):
                inverter.stop(lambda: 200.0)
        deadline_s = time.monotonic() + DEADLINE_S
        codes: list[str] = []
        while "inverter.off" not in codes:
            assert time.monotonic() < deadline_s
            codes += [notice.code for notice in inverter.take_notices()]
        assert not inverter.read().running


@pytest.mark.parametrize("stop", [FrInverter.stop, FrInverter.cut])
def test_what_was_stopped_before_it_started_starts_once_it_is_armed_anew(
    bench: tuple[EmulatedInstrument, Ends], stop: Callable[[FrInverter], None]
) -> None:
    with opened(settings_for(bench[0].address)) as inverter:
        inverter.arm(200.0)
        stop(inverter)
        with pytest.raises(InstrumentRefused, match="not done: a stop overtook it"):
            inverter.start()
        assert not inverter.read().running
        inverter.arm(200.0)
        inverter.start()
        assert inverter.read().running
        inverter.stop()


def test_it_is_a_speed_drive(bench: tuple[EmulatedInstrument, Ends]) -> None:
    drive: SpeedDrive = FrInverter(settings_for(bench[0].address))
    assert drive.state is None
    assert drive.identity == ""


def test_the_current_is_that_of_the_load(bench: tuple[EmulatedInstrument, Ends]) -> None:
    emulator, ends = bench
    with opened(settings_for(emulator.address)) as inverter:
        ends.currents.send(1.23)
        deadline_s = time.monotonic() + DEADLINE_S
        while inverter.read().output_current_a != pytest.approx(1.23, abs=0.0051):
            assert time.monotonic() < deadline_s


@pytest.mark.parametrize("rpm", [-1.0, 301.0, math.nan, math.inf])
def test_a_speed_that_the_bench_forbids_is_not_sent(
    rpm: float, bench: tuple[EmulatedInstrument, Ends]
) -> None:
    with opened(settings_for(bench[0].address)) as inverter:
        with pytest.raises(InstrumentRefused, match="outside 0 to 300 rpm; nothing was sent"):
            inverter.set_speed(rpm)
        assert inverter.read().set_rpm == 0.0 or inverter.read().set_rpm == pytest.approx(200.1)


def test_another_station_than_the_drives_is_silent(bench: tuple[EmulatedInstrument, Ends]) -> None:
    settings = replace(settings_for(bench[0].address), station=2, answer_s=0.1)
    with pytest.raises(InstrumentSilent, match=r"no answer to 41001 .*station number, speed and parity"):
        FrInverter(settings).open()


def test_every_kind_of_fault_of_a_line_at_once(bench: tuple[EmulatedInstrument, Ends]) -> None:
    """Over the real wire, with pymodbus's client between: a value is right or it is no value."""
    emulator, ends = bench
    with opened(settings_for(emulator.address)) as inverter:
        inverter.set_speed(200.0)
        ends.rehearsal.send(LineFaults(0.3, tuple(KINDS), seed=5))
        believed = 0
        for _ in range(8):
            with suppress(InstrumentSilent):
                state = inverter.read()
                assert state.set_rpm == pytest.approx(200.1, abs=1e-9)
                assert (state.speed_rpm, state.running) == (0.0, False)
                believed += 1
        ends.rehearsal.send(LineFaults())
        assert believed > 0
        assert inverter.health is not None
        assert inverter.health.unanswered + inverter.health.resynchronised > 0


def test_a_trip_reaches_whoever_checks_and_whoever_opens_it_next() -> None:
    with emulated() as (emulator, ends):
        settings = settings_for(emulator.address)
        with opened(settings) as inverter:
            inverter.set_speed(200.0)
            inverter.start()
            ends.rehearsal.send(rehearsed("inverter.trips:code=0x10"))
            ends.await_output(lambda output: not output.on)
            with pytest.raises(InstrumentRefused, match=r"it has tripped: E\.OC1") as caught:
                check_until_it_raises(inverter)
            assert caught.value.code == "E.OC1"
            with pytest.raises(InstrumentRefused, match=r"it has tripped: E\.OC1"):
                inverter.start()
        with pytest.raises(InstrumentRefused, match=r"it has tripped: E\.OC1.* reset it at its panel"):
            FrInverter(settings).open()


def test_when_the_program_dies_the_drive_stops_by_itself() -> None:
    with emulated() as (emulator, ends):
        with subprocess.Popen(  # noqa: S603 - our own text
            [sys.executable, "-c", CHILD, emulator.address], stdout=subprocess.PIPE, text=True
        ) as program:
            assert program.stdout is not None
            assert program.stdout.readline() == "runs\n"
            ends.await_output(lambda output: output.target > 0.0)
            program.send_signal(signal.SIGKILL)
            killed_s = time.monotonic()
        output = ends.await_output(lambda output: output.target == 0.0)
        # The last poll was up to a period and an answer before; how exact the drive is: test_fr_drive.
        assert WATCHDOG_S - 0.5 < output.started_s - killed_s < WATCHDOG_S + 0.5
        assert output.on
        assert output.level == pytest.approx(6.67, abs=1e-9)


def test_wrong_settings_are_all_told_and_the_drive_can_be_opened_after_that() -> None:
    with emulated(InverterSetup(FAST | {122: 9999, 120: 0})) as (emulator, _):
        inverter = FrInverter(settings_for(emulator.address))
        with pytest.raises(InverterMisconfigured, match=r"Pr\.122 .*9999 \(off\)") as caught:
            inverter.open()
        assert {problem.key.split()[0] for problem in caught.value.problems} == {"Pr.120", "Pr.122"}
        with pytest.raises(DeviceLost, match="the connection is closed"):
            inverter.read()


def test_it_listens_on_loopback_only(bench: tuple[EmulatedInstrument, Ends]) -> None:
    listeners = [
        connection.laddr.ip
        for connection in psutil.Process(bench[0].pid).net_connections(kind="inet")
        if connection.status == psutil.CONN_LISTEN
    ]
    assert listeners == ["127.0.0.1"]


def plain_registers() -> dict[int, int]:
    blocks = [register.number for block in (STATUS_BLOCK, MONITOR_BLOCK) for register in block.registers]
    zeros = dict.fromkeys([*blocks, *(fault.number for fault in FAULTS), RUNNING_FREQUENCY.number], 0)
    parameters = {41000 + number: raw for number, raw in (PARAMETERS | FAST).items()}
    return zeros | parameters | {40010: 4, 40201: 5, 40202: 87, 40203: 1104, 40501: 0xB1}


def test_a_foreign_modbus_device_is_read_and_written() -> None:
    with PlainServer(plain_registers()) as peer, opened(settings_for(peer.port)) as inverter:
        state = inverter.read()
        assert state.output_frequency_hz == pytest.approx(0.05, abs=1e-12)
        assert state.output_current_a == pytest.approx(0.87, abs=1e-12)
        assert state.output_voltage_v == pytest.approx(110.4, abs=1e-9)
        assert inverter.health is not None
        assert (inverter.health.unanswered, inverter.health.resynchronised) == (0, 0)


def test_a_foreign_device_that_is_no_drive_does_not_run() -> None:
    """Plain registers keep what is written to them, and no status follows from it."""
    with PlainServer(plain_registers()) as peer, opened(settings_for(peer.port)) as inverter:
        assert inverter.set_speed(200.0) == pytest.approx(200.1, abs=1e-9)
        with pytest.raises(InstrumentRefused, match="not obeyed: run forward; it reads 2"):
            inverter.start()


def test_a_foreign_device_that_already_runs_is_refused_and_not_written_to() -> None:
    with PlainServer(plain_registers() | {40009: 0x000B, 40014: 500}) as peer:
        told = r"at socket://.*: it already runs: its output is at 0\.05 Hz .*, its set value is 150 rpm"
        for _ in range(2):  # plain registers would show the second time what the first had written
            with pytest.raises(InstrumentRefused, match=told):
                FrInverter(settings_for(peer.port)).open()


def test_a_foreign_device_without_a_register_is_told_which() -> None:
    registers = {number: raw for number, raw in plain_registers().items() if number != 41122}
    told = pytest.raises(InstrumentRefused, match=r"exception 02 .* at 41122 .Pr\.122 PU communication")
    with PlainServer(registers) as peer, told:
        FrInverter(settings_for(peer.port)).open()


def test_a_line_that_its_other_end_has_dropped_is_opened_anew_and_one_that_stands_is_left() -> None:
    taken = list[asyncio.StreamWriter]()

    async def take(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        taken.append(writer)

    async def work() -> None:
        server = await asyncio.start_server(take, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        line = SerialLine(settings_for(f"socket://127.0.0.1:{port}"), time.monotonic)
        await line.open()
        assert not await line.reopen()
        await asyncio.sleep(0.1)
        assert len(taken) == 1
        taken[0].close()
        await asyncio.sleep(0.1)
        with pytest.raises(DeviceLost):
            await line.ask(Request(1, READ, STATUS_BLOCK.address, STATUS_BLOCK.count))
        assert await line.reopen()
        await asyncio.sleep(0.1)
        assert len(taken) == 2
        line.close()
        taken[1].close()
        server.close()

    asyncio.run(work())


def test_it_is_busy_as_long_as_a_caller_waits_and_no_longer_where_that_one_hangs() -> None:
    inverter = FrInverter(settings_for("socket://127.0.0.1:1"))
    session = inverter._open = _Open(inverter.settings, SystemClock(), Notices(SystemClock()))
    try:
        assert not inverter.busy
        future = asyncio.run_coroutine_threadsafe(session._counted(asyncio.sleep(0.3)), session._loop)
        await_true("it is at work", lambda: inverter.busy, 1.0)
        await_true("it has done", lambda: not inverter.busy, 1.0)  # though nobody has asked for the result
        assert future.done()
        caller = threading.Thread(target=session.run, args=(asyncio.sleep(0.3),))
        caller.start()
        await_true("it is at work", lambda: inverter.busy, 1.0)
        caller.join()
        assert not inverter.busy
    finally:
        inverter.close()


def test_a_loop_that_hangs_at_the_end_keeps_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.mitsubishi_fr.inverter.HANGS_S", 0.2)
    session = _Open(settings_for("socket://127.0.0.1:1"), SystemClock(), Notices(SystemClock()))
    goes_on = threading.Event()

    async def hang() -> None:
        goes_on.wait()  # in the loop's own thread

    monkeypatch.setattr(session.poller, "close", hang)
    ending = threading.Thread(target=session.end)
    ending.start()
    ending.join(DEADLINE_S)
    kept = ending.is_alive()
    goes_on.set()
    ending.join()
    session._thread.join()
    session._loop.close()  # which was left as it was
    assert not kept
