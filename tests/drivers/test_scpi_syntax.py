"""SCPI taken apart at both ends: answers by the driver, program messages by the emulators."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.protocols.generator import DriveSettings
from drivers.scpi.emulator.agilent_33220a import Emulated33220A
from drivers.scpi.emulator.command_tree import CommandError
from drivers.scpi.emulator.keysight_n6900 import EmulatedN6900
from drivers.scpi.language import error_in, model_in, number_in

WORDS = st.sampled_from(
    """*IDN? *RST *CLS *TRG *OPC *OPC? *ESE *SRE *ESR? *STB? SYST:ERR? FREQ FREQ? VOLT VOLT:OFFS VOLT:UNIT
    PHAS OUTP OUTP:LOAD BURS:MODE BURS:NCYC BURS:PHAS BURS:STAT TRIG:SOUR APPL:SIN SOUR1:FREQ : ; , ? 1
    -1E99 9.9E37 NAN INF MIN MAX DEF ON OFF BUS TRIG
    VPP DBM VRMS SIN SQU KHZ V \" ' \x00 \x7f é""".split()  # noqa: SIM905
)
MESSAGES = st.one_of(st.text(max_size=200), st.lists(WORDS, max_size=20).map(" ".join))


class Bench:
    """An instrument without a wire, on a clock that a test moves."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.outputs: list[DriveSettings] = []
        self.instrument = Emulated33220A(self.outputs.append, lambda: self.now_s)

    def ask(self, message: str) -> str | None:
        return self.instrument.run(message)

    def errors(self) -> list[int]:
        codes = []
        while (code := error_in(self.ask("SYST:ERR?") or "")[0]) != 0:
            codes.append(code)
        return codes


@settings(deadline=None)  # a busy machine is no fault
@given(st.lists(MESSAGES, max_size=10))
def test_no_message_breaks_the_emulator(messages: list[str]) -> None:
    bench = Bench()
    for message in messages:
        bench.ask(message)
        bench.now_s += 0.1
    for output in bench.outputs:
        assert 0.0 <= output.amplitude_v <= 10.0
        assert abs(output.offset_v) + output.amplitude_v <= 10.0 + 1e-9
        assert 1e-6 <= output.frequency_hz <= 20e6
        assert 0.0 <= output.phase_rad <= math.tau
    assert len(bench.errors()) <= 20


@settings(deadline=None)  # a busy machine is no fault
@given(st.text(max_size=300))
def test_no_answer_breaks_the_driver(answer: str) -> None:
    for parse in (number_in, error_in):
        try:
            result = parse(answer)
        except ValueError:
            continue
        assert not (isinstance(result, float) and math.isnan(result))
    assert isinstance(model_in(answer), str)


@settings(deadline=None)  # a busy machine is no fault
@given(st.floats(1e-6, 20e6), st.floats(0.02, 20.0))
def test_what_is_set_is_read_back(frequency_hz: float, vpp: float) -> None:
    bench = Bench()
    bench.ask(f"OUTP:LOAD INF;:FREQ {frequency_hz:.10g};VOLT {vpp:.10g}")
    assert number_in(bench.ask("FREQ?") or "") == pytest.approx(frequency_hz, rel=1e-9, abs=1e-6)
    assert number_in(bench.ask("VOLT?") or "") == pytest.approx(vpp, rel=1e-9)
    assert bench.errors() == []


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        ("frequency 20;FREQ?", "+2.0000000000000E+01"),
        ("SOURce1:FREQuency 2 kHz;:FREQ?", "+2.0000000000000E+03"),
        ("TRIG:SOUR BUS;:SOUR:BURS:MODE TRIG;NCYC INF;STAT ON;:BURS:NCYC?;STAT?", "+9.9000000000000E+37;1"),
        ("OUTP:LOAD INFinity;LOAD?", "+9.9000000000000E+37"),
        ("VOLT? MAX", "+1.0000000000000E+01"),
        ("OUTP:LOAD INF;:VOLT? MAXimum", "+2.0000000000000E+01"),
        ("VOLT?;:OUTP:LOAD INF;:VOLT?", "+1.0000000000000E-01;+2.0000000000000E-01"),
        ("OUTP:LOAD INF;:VOLT 2;VOLT:UNIT VRMS;:VOLT?", f"{1 / math.sqrt(2):+.13E}"),
        ("VOLT:UNIT DBM;:VOLT 0;VOLT:UNIT VPP;:VOLT?", f"{math.sqrt(0.05) * math.sqrt(8):+.13E}"),
        ("*IDN?;*OPC?", "Agilent Technologies,33220A,MY00000000,2.02-2.02-22-2;1"),
        ("SYST:VERS?", "1999.0"),
        ("TRIG:SOUR bus;SOUR?", "BUS"),
        ("", None),
        (";;", None),
    ],
)
def test_answers(message: str, answer: str | None) -> None:
    bench = Bench()
    assert bench.ask(message) == answer
    assert bench.errors() == []


@pytest.mark.parametrize(
    ("message", "codes"),
    [
        ("FROBNICATE 1", [-113]),
        ("FREQ", [-109]),
        ("FREQ 1,2", [-108]),
        ("FREQ 1 V", [-131]),
        ("FREQ fast", [-148]),
        ("FREQ 1..2", [-121]),
        ("FREQ 30 MHZ", [-222]),
        ("FREQ 1E99999", [-222]),
        ("FREQ " + "1" * 60000 + "x", [-121]),
        ("VOLT 10.1", [-222]),
        ("OUTP:LOAD INF;:VOLT 20;VOLT:OFFS 1", [-222]),
        ("OUTP:LOAD INF;:VOLT:OFFS 5;:VOLT 20", [-221]),
        ("OUTP:LOAD INF;:VOLT:UNIT DBM", [-221]),
        ("FUNC SQU", [-241]),
        ("BURS:NCYC INF", [-221]),
        ("TRIG:SOUR BUS;:BURS:STAT ON;:OUTP ON;*TRG", [-241]),
        ("FUNC TRIANGLE", [-224]),
        ("*TRG", [-211]),
        ("*RST 1", [-108]),
        ("*RST?", [-113]),
        ("VOLT:OFFS 0;VOLT 1", [-113]),  # the path of the first carries on: VOLT:VOLT
        ("FROB;FREQ 20", [-113]),
        ("FREQ\x01 2", [-101]),
        (";".join(["VOLT 99"] * 25), [-222] * 19 + [-350]),
    ],
)
def test_errors(message: str, codes: list[int]) -> None:
    bench = Bench()
    bench.ask(message)
    assert bench.errors() == codes


def test_cls_empties_the_error_queue() -> None:
    bench = Bench()
    bench.ask("FROB")
    bench.ask("*CLS")
    assert bench.errors() == []


@pytest.mark.parametrize("make", [Emulated33220A, EmulatedN6900])
def test_what_happened_stands_in_the_registers_until_it_is_read(
    make: Callable[[Callable[[object], None], Callable[[], float]], Emulated33220A | EmulatedN6900],
) -> None:
    """IEEE 488.2, chapter 11: events are kept until read, masks make of them a summary and a request."""
    instrument = make(lambda output: None, lambda: 0.0)
    ask = instrument.run
    assert ask("*ESR?;*ESR?;*STB?;*TST?") == "128;0;0;0"  # it was switched on, once
    ask("*ESE 48;*SRE 36")  # of commands and of their execution; the error queue and the summary of events
    ask("FROB")
    ask("VOLT 1E3")
    assert ask("*ESE?;*SRE?;*STB?;*ESR?") == "48;36;100;48"
    assert ask("*STB?;*ESR?") == "68;0"  # what was read is gone, the queue is as it was
    assert (ask("SYST:ERR?;ERR?;*STB?") or "").endswith(";0")
    ask("*OPC")
    assert ask("*STB?;*ESR?") == "0;1"  # its mask leaves that out
    for code in (-410, -363):
        instrument.status.report(CommandError(code))
    assert ask("*ESR?") == "12"
    ask("*SRE 255;*ESE 256;*ESE 1,2")
    assert ask("*SRE?;*ESE?;*ESR?") == "191;48;48"  # refused, and said so
    ask("FROB;*ESE 0")
    ask("*CLS")
    assert ask("*ESR?;*STB?;*ESE?;SYST:ERR?") == '0;0;48;+0,"No error"'
    for _ in range(21):
        ask("VOLT 1E3")
    assert ask("*ESR?") == "24"  # a queue that runs over is the device's


def test_output_is_told_only_where_it_changes() -> None:
    bench = Bench()
    bench.ask("OUTP:LOAD INF;:FREQ 20;VOLT 2;:OUTP OFF")
    assert bench.outputs == []
    bench.ask("OUTP ON;:OUTP ON;:FREQ 20;VOLT 2;VOLT:UNIT VRMS")
    assert bench.outputs == [DriveSettings(True, 20.0, 1.0, 0.0, 0.0, 0.0)]
    bench.now_s = 0.0125  # a quarter of a cycle
    bench.ask("FREQ 40")
    assert bench.outputs[-1].phase_rad == pytest.approx(math.pi / 2.0)
    bench.ask("*RST")
    assert not bench.outputs[-1].on
    assert len(bench.outputs) == 3


def test_burst_begins_at_its_phase_and_amplitude_changes_go_on() -> None:
    bench = Bench()
    bench.ask("OUTP:LOAD INF;:FREQ 20;VOLT 2;:TRIG:SOUR BUS;:BURS:NCYC INF;PHAS 90;STAT ON;:OUTP ON")
    bench.now_s = 1.0
    bench.ask("*TRG")
    bench.now_s = 1.0125
    bench.ask("VOLT 4")
    waiting, begun, louder = bench.outputs
    assert (waiting.on, waiting.amplitude_v) == (True, 0.0)
    assert (begun.amplitude_v, begun.started_s, louder.amplitude_v) == (1.0, 1.0, 2.0)
    assert begun.phase_rad == pytest.approx(math.pi / 2.0)
    assert louder.phase_rad == pytest.approx(math.pi)
