"""The SCPI generator driver against the emulated 33220A in another process."""

from __future__ import annotations

import math
import multiprocessing
import socket
import time
from collections.abc import Iterator
from itertools import pairwise
from multiprocessing.connection import Connection

import numpy as np
import psutil
import pytest
import pyvisa

from daq.clock import SystemClock
from daq.errors import InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.emulator_process import EmulatedInstrument
from drivers.protocols.generator import DriveGenerator, DriveSettings
from drivers.rehearsal import rehearsed
from drivers.scpi.emulator.process import SourceSetup, start_function_generator
from drivers.scpi.generator import GeneratorSettings, ScpiGenerator
from drivers.scpi.language import Choice
from drivers.scpi.link import ScpiLink

DEADLINE_S = 5.0


@pytest.fixture(scope="module")
def outputs() -> Iterator[tuple[tuple[str, ...], Connection]]:
    """Addresses of an emulator, and what it tells a plant."""
    receiver, sender = multiprocessing.get_context("spawn").Pipe(duplex=False)
    with start_function_generator(sender) as emulator, receiver:
        sender.close()
        yield emulator.addresses, receiver


@pytest.fixture(params=[0, 1], ids=["TCP", "pty"])
def generator(
    outputs: tuple[tuple[str, ...], Connection], request: pytest.FixtureRequest
) -> Iterator[ScpiGenerator]:
    driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=outputs[0][request.param]))
    driver.open()
    yield driver
    driver.off()
    driver.close()


def heard(outputs: tuple[tuple[str, ...], Connection], count: int) -> list[DriveSettings]:
    settings = []
    for _ in range(count):
        assert outputs[1].poll(DEADLINE_S)
        settings.append(outputs[1].recv())
    assert not outputs[1].poll(0)
    return settings


def test_opened_twice_it_is_connected_once(generator_emulator: EmulatedInstrument) -> None:
    link = ScpiLink("signal generator", generator_emulator.address)
    port = int(generator_emulator.address.split("::")[2])
    try:
        link.open()
        first = link._visa  # held, as by a traceback: it must not take the garbage collector to close it
        link.open()
        assert link._visa is not first
        ends = [each.raddr for each in psutil.Process().net_connections(kind="tcp") if each.raddr]
        assert [end.port for end in ends].count(port) == 1
    finally:
        link.close()


def test_says_who_it_is(generator: DriveGenerator) -> None:
    assert generator.identity.startswith("Agilent Technologies,33220A,")


def test_soft_start_keeps_the_phase(
    generator: DriveGenerator, outputs: tuple[tuple[str, ...], Connection]
) -> None:
    generator.arm_sine(20.0, 0.01, 0.25, triggered=False)
    assert not outputs[1].poll(0), "arming must not move the shaker"
    generator.start()
    for amplitude_v in (1.0, 2.0):
        generator.set_amplitude(amplitude_v)
    generator.set_offset(0.0)
    generator.off()
    *on, off = heard(outputs, 5)
    assert [(s.amplitude_v, s.offset_v) for s in on] == [(0.01, 0.25), (1.0, 0.25), (2.0, 0.25), (2.0, 0.0)]
    assert all(s.on and s.frequency_hz == 20.0 for s in on)
    assert not off.on
    for before, after in pairwise(on):
        advance = math.tau * 20.0 * (after.started_s - before.started_s)
        difference = (after.phase_rad - before.phase_rad - advance + math.pi) % math.tau - math.pi
        assert abs(difference) < 1e-9  # rounding of doubles near 1e4 s of uptime times 125 rad/s


def test_triggered_start_waits_at_the_offset_and_begins_at_phase_zero(
    generator: DriveGenerator, outputs: tuple[tuple[str, ...], Connection]
) -> None:
    generator.arm_sine(20.0, 2.5, 0.1, triggered=True)
    before_s = SystemClock().monotonic_s()
    generator.start()
    after_s = SystemClock().monotonic_s()
    generator.off()
    waiting, running, off = heard(outputs, 3)
    assert (waiting.on, waiting.amplitude_v, waiting.offset_v) == (True, 0.0, 0.1)
    assert (running.on, running.amplitude_v, running.phase_rad) == (True, 2.5, 0.0)
    assert before_s < running.started_s < after_s
    assert not off.on


def test_off_is_safe_at_any_time(
    generator: ScpiGenerator, outputs: tuple[tuple[str, ...], Connection]
) -> None:
    generator.off()
    generator.off()
    generator.close()
    generator.off()
    assert heard(outputs, 0) == []


@pytest.mark.parametrize(
    ("amplitude_v", "offset_v"),
    [(5.001, 0.0), (3.0, 2.5), (3.0, -2.5), (math.nan, 0.0), (0.0, 0.0), (1.0, math.nan)],
)
def test_nothing_is_sent_beyond_the_limit(
    generator: DriveGenerator,
    outputs: tuple[tuple[str, ...], Connection],
    amplitude_v: float,
    offset_v: float,
) -> None:
    with pytest.raises(InstrumentRefused, match="nothing was sent") as caught:
        generator.arm_sine(20.0, amplitude_v, offset_v, triggered=False)
    assert caught.value.code == "limit"
    assert heard(outputs, 0) == []


def test_limit_holds_while_running(
    generator: DriveGenerator, outputs: tuple[tuple[str, ...], Connection]
) -> None:
    generator.arm_sine(20.0, 3.0, 1.0, triggered=False)
    generator.start()
    with pytest.raises(InstrumentRefused, match=r"5\.5 V is above the bench's limit of 5 V"):
        generator.set_amplitude(4.5)
    with pytest.raises(InstrumentRefused, match="nothing was sent"):
        generator.set_offset(2.01)
    assert [s.amplitude_v for s in heard(outputs, 1)] == [3.0]
    generator.off()
    heard(outputs, 1)


def test_a_running_sine_takes_a_step_of_frequency_to_a_microhertz_and_keeps_its_phase(
    generator: DriveGenerator, outputs: tuple[tuple[str, ...], Connection]
) -> None:
    """Steps of a sweep are held to 2 parts in 10,000; the generator is told 10 digits and keeps 1 uHz."""
    generator.arm_sine(19.5, 1.0, 0.0, triggered=False)
    generator.start()
    generator.set_frequency(19.557692307692307)
    generator.off()
    before, after, _ = heard(outputs, 3)
    assert after.frequency_hz == pytest.approx(19.557692307692307, abs=1e-6)
    turned = before.phase_rad + math.tau * before.frequency_hz * (after.started_s - before.started_s)
    assert abs((after.phase_rad - turned + math.pi) % math.tau - math.pi) < 1e-9


@pytest.mark.parametrize("command", ["OUTP OFF", "VOLT 4", "VOLT:OFFS 0.1", "FREQ 21", "OUTP:LOAD 50"])
@pytest.mark.parametrize("triggered", [False, True])
def test_whatever_another_program_turns_is_found(
    generator_emulator: EmulatedInstrument, command: str, triggered: bool
) -> None:
    address = generator_emulator.address
    driver, other = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=address)), ScpiLink("other", address)
    driver.open()
    try:
        driver.arm_sine(20.0, 1.0, 0.0, triggered=triggered)
        driver.start()
        started_s = time.monotonic()
        for _ in range(20):
            driver.check()
        other.open()
        before_s = time.monotonic()
        other.write(command)
        other.query("*OPC?")
        with pytest.raises(InstrumentRefused, match="which it was not told") as told:  # noqa: PT012
            for _ in range(5):
                driver.check()
        assert told.value.right_s is not None
        assert started_s < told.value.right_s < before_s  # what came after may not be as it was told
        driver.off()
    finally:
        other.close()
        driver.close()


def test_frequency_beyond_the_instrument(generator: DriveGenerator) -> None:
    with pytest.raises(InstrumentRefused, match="frequency = 3e\\+07 Hz is outside"):
        generator.arm_sine(30e6, 1.0, 0.0, triggered=False)


def test_start_without_arming_a_burst(generator: ScpiGenerator) -> None:
    generator.arm_sine(20.0, 1.0, 0.0, triggered=True)
    generator._link.write("BURS:STAT OFF")
    with pytest.raises(InstrumentRefused, match="trigger: -211 Trigger ignored") as caught:
        generator.start()
    assert caught.value.code == "-211"


@pytest.mark.parametrize("triggered", [False, True])
def test_a_start_that_a_stop_came_before_turns_nothing_on(generator: ScpiGenerator, triggered: bool) -> None:
    generator.arm_sine(20.0, 1.0, 0.0, triggered=triggered)
    generator.off()
    with pytest.raises(InstrumentRefused, match="switched off while it was to start"):
        generator.start()
    assert generator._link.query("OUTP?").strip() == "0"


def test_a_start_that_overtakes_a_stop_is_taken_back(
    generator: ScpiGenerator, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator.arm_sine(20.0, 1.0, 0.0, triggered=False)
    choose = generator._choose

    def overtaken(choice: Choice, until_s: float) -> None:
        generator.off()  # in another thread, just before
        choose(choice, until_s)

    monkeypatch.setattr(generator, "_choose", overtaken)
    with pytest.raises(InstrumentRefused, match="switched off while it was to start"):
        generator.start()
    assert generator._link.query("OUTP?").strip() == "0"


@pytest.mark.parametrize("triggered", [False, True])
def test_a_start_that_comes_late_moves_nothing(
    generator: ScpiGenerator,
    outputs: tuple[tuple[str, ...], Connection],
    monkeypatch: pytest.MonkeyPatch,
    triggered: bool,
) -> None:
    """As of a process that was stopped before the write, for longer than anybody watched it."""
    while outputs[1].poll(0):  # what was told before
        outputs[1].recv()
    generator.arm_sine(20.0, 1.0, 0.0, triggered=triggered)
    now_s, slept_s = time.monotonic, iter([0.0])  # when it was asked; a second later ever after
    monkeypatch.setattr(time, "monotonic", lambda: now_s() + next(slept_s, 1.0))
    with pytest.raises(InstrumentRefused, match="s too late; it was not sent") as caught:
        generator.start()
    assert caught.value.code == "late"
    monkeypatch.undo()
    generator.off()
    while outputs[1].poll(0):
        told = outputs[1].recv()
        assert not told.on or (triggered and told.amplitude_v == 0.0)


@pytest.mark.parametrize("way", [0, 1], ids=["TCP", "pty"])
def test_what_an_earlier_client_left_is_cleared(way: int) -> None:
    setup = SourceSetup(pending_errors=(-410, -420, *[-113] * 30), stale_answer=b"+1.5E+00\nhalf an ans")
    with start_function_generator(setup=setup) as emulator:
        driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=emulator.addresses[way]))
        driver.open()
        driver.arm_sine(20.0, 1.0, 0.0, triggered=False)
        driver.close()


@pytest.mark.parametrize("how", ["garbled", "unterminated"])
def test_answers_that_lack_their_end_or_their_sense_end_a_drive(how: str) -> None:
    setup = SourceSetup(rehearsed=(rehearsed(f"signal_generator.{how}"),))
    with start_function_generator(setup=setup) as emulator:
        settings = GeneratorSettings(1.0, 5.0, resource=emulator.address, timeout_s=0.4)
        driver = ScpiGenerator(settings)
        driver.open()
        driver.arm_sine(20.0, 1.0, 0.0, triggered=False)
        error = InstrumentSilent if how == "unterminated" else InstrumentRefused
        with pytest.raises(error):  # noqa: PT012 - at the first question after it
            driver.start()
            for _ in range(20):
                driver.check()
        with pytest.raises(error):  # it went off, and nobody can say so
            driver.off()
        driver.close()


def test_half_a_command_of_an_earlier_client(generator_emulator: EmulatedInstrument) -> None:
    address = generator_emulator.addresses[1]
    earlier = pyvisa.ResourceManager("@py").open_resource(address)
    earlier.write_raw(b"FREQ 1")  # type: ignore[attr-defined]
    earlier.close()
    driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=address))
    driver.open()
    driver.arm_sine(20.0, 1.0, 0.0, triggered=False)
    driver.close()


def test_noise_on_the_line_does_not_stop_the_emulator(generator_emulator: EmulatedInstrument) -> None:
    noise = np.random.default_rng(1).bytes(300_000).replace(b"\n", b"", 1) + b"\x00" * 70_000
    port = int(generator_emulator.address.split("::")[2])
    with socket.create_connection(("127.0.0.1", port), DEADLINE_S) as client:
        client.sendall(noise + b"\n*CLS\n*IDN?\n")
        with client.makefile("rb") as answers:
            assert any(line.startswith(b"Agilent Technologies,33220A,") for line in answers)


@pytest.mark.parametrize(
    "identity", ["Stanford Research Systems,DS345,1,1.0", "Agilent Technologies,34401A,0,1", "33220A", ""]
)
def test_another_model_answers(identity: str) -> None:
    with start_function_generator(setup=SourceSetup(identity=identity)) as emulator:
        driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=emulator.address))
        with pytest.raises(InstrumentAbsent, match="which is no 33210A, 33220A") as caught:
            driver.open()
        assert repr(identity) in caught.value.what
        assert caught.value.address == emulator.address
