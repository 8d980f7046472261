"""The SCPI driver over its normal way, VISA on a TCP socket, to a server that we did not write: sinstruments.

Socket, lines and clients are the package's; the table of settings below is ours, in the short forms of the
33220A User's Guide, chapter 4, with the 16 digits of a 33500 (M).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

import pytest

from daq.errors import DeviceLost, InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.scpi.generator import GeneratorSettings, ScpiGenerator

simulator = pytest.importorskip("sinstruments.simulator")
serving = pytest.importorskip("sinstruments.pytest")

IDENTITY = "Agilent Technologies,33522B,MY50000001,3.03-1.19-2.00-52-00"
NO_ERROR = '+0,"No error"'
WORDS = {"ON": "1", "OFF": "0", "INF": "+9.900000000000000E+37"}
AFTER_RESET = {
    "FREQ": "+1.000000000000000E+03",
    "VOLT": "+1.000000000000000E-01",
    "VOLT:OFFS": "+0.000000000000000E+00",
    "VOLT:UNIT": "VPP",
    "FUNC": "SIN",
    "OUTP": "0",
    "OUTP:LOAD": "+5.000000000000000E+01",
    "BURS:MODE": "TRIG",
    "BURS:NCYC": "+1.000000000000000E+00",
    "BURS:PHAS": "+0.000000000000000E+00",
    "BURS:STAT": "0",
    "TRIG:SOUR": "IMM",
}


class Generator33522B(simulator.BaseDevice):  # type: ignore[misc, name-defined]
    """Keeps settings but those that it `refuses` or `clips`; `mute` gets no answer, `fatal` ends the line."""

    def __init__(self, name: str, **keys: Any) -> None:
        super().__init__(name, **keys)
        self.identity = IDENTITY
        self.kept = dict(AFTER_RESET)
        self.errors = ['-113,"Undefined header"', '-420,"Query UNTERMINATED"']  # of whoever was here before
        self.heard: Counter[str] = Counter()
        self.refuses: dict[str, str] = {}
        self.clips: dict[str, str] = {}
        self.mute: set[str] = set()
        self.fatal: set[str] = set()

    def handle_message(self, message: bytes) -> bytes | None:
        header, _, parameter = message.decode("ascii").strip().partition(" ")
        self.heard[header] += 1
        if header in self.fatal:
            raise OSError("the instrument restarts")  # the server closes the connection
        if header in self.mute:
            return None
        if header.endswith("?"):
            return self._answer(header[:-1])
        if header == "*RST":
            self.kept = dict(AFTER_RESET)
        elif header == "*CLS":
            self.errors.clear()
        elif header in self.refuses:
            self.errors.append(self.refuses[header])
        elif header in self.kept:
            self.kept[header] = self.clips.get(header, _as_kept(parameter))
        elif header not in ("", "*TRG"):
            self.errors.append('-113,"Undefined header"')
        return None

    def _answer(self, header: str) -> bytes | None:
        if header == "SYST:ERR":
            return _line(self.errors.pop(0) if self.errors else NO_ERROR)
        answers = {"*IDN": self.identity, "*OPC": "1"} | self.kept
        if header in answers:
            return _line(answers[header])
        self.errors.append('-113,"Undefined header"')
        return None


def _as_kept(parameter: str) -> str:
    if parameter in WORDS:
        return WORDS[parameter]
    try:
        return f"{float(parameter):+.15E}"
    except ValueError:
        return parameter


def _line(text: str) -> bytes:
    return text.encode("ascii") + b"\n"


class Bench:
    """The foreign server with its instrument, and our driver, not open yet."""

    def __init__(self) -> None:
        device = {
            "name": "generator",
            "package": __name__,
            "class": Generator33522B.__name__,
            "transports": [{"type": "tcp", "url": "127.0.0.1:0"}],
        }
        self.server = serving.server_context({"devices": [device]})
        self.server.start()
        self.instrument: Generator33522B = self.server.server.devices["generator"]
        host, port = self.instrument.transports[0].address
        resource = f"TCPIP::{host}::{port}::SOCKET"
        self.driver = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=resource, timeout_s=0.5))


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.driver.close()
    bench.server.stop()


def test_a_foreign_server_is_set_started_and_switched_off(bench: Bench) -> None:
    driver, instrument = bench.driver, bench.instrument
    driver.open()
    assert driver.identity == IDENTITY
    driver.arm_sine(20.0, 1.0, 0.25, triggered=True)
    assert instrument.kept == AFTER_RESET | {
        "FREQ": "+2.000000000000000E+01",
        "VOLT": "+2.000000000000000E+00",
        "VOLT:OFFS": "+2.500000000000000E-01",
        "OUTP": "1",
        "OUTP:LOAD": "+9.900000000000000E+37",
        "TRIG:SOUR": "BUS",
        "BURS:NCYC": "+9.900000000000000E+37",
        "BURS:STAT": "1",
    }
    assert instrument.heard["*TRG"] == 0
    driver.start()
    assert instrument.heard["*TRG"] == 1
    driver.set_frequency(19.557692307692307)
    driver.set_amplitude(0.5)
    assert float(instrument.kept["FREQ"]) == pytest.approx(19.557692307692307, abs=1e-8)  # ten digits
    assert float(instrument.kept["VOLT"]) == 1.0
    driver.off()
    assert instrument.kept["OUTP"] == "0"
    assert instrument.errors == []


def test_what_a_foreign_server_refuses_is_told_in_its_words(bench: Bench) -> None:
    bench.instrument.refuses["FREQ"] = '-222,"Data out of range; value clipped to upper limit"'
    bench.driver.open()
    with pytest.raises(InstrumentRefused, match="frequency = 20 Hz: -222 Data out of range") as caught:
        bench.driver.arm_sine(20.0, 1.0, 0.0, triggered=False)
    assert caught.value.code == "-222"
    assert bench.instrument.kept["OUTP"] == "0"


def test_what_a_foreign_server_keeps_otherwise_is_no_setting(bench: Bench) -> None:
    bench.instrument.clips["VOLT"] = "+9.000000000000000E-01"
    bench.driver.open()
    with pytest.raises(InstrumentRefused, match=r"amplitude = 1 Vpp reads back \+9\.0+E-01"):
        bench.driver.arm_sine(20.0, 0.5, 0.0, triggered=False)
    assert bench.instrument.kept["OUTP"] == "0"


def test_another_instrument_on_a_foreign_server(bench: Bench) -> None:
    bench.instrument.identity = "Agilent Technologies,34410A,MY47000001,2.35-2.35-0.09-46-09"
    with pytest.raises(InstrumentAbsent, match=r"34410A.* answers, which is no 33210A, 33220A"):
        bench.driver.open()


def test_another_of_the_same_model_is_not_driven(bench: Bench) -> None:
    own = bench.instrument.identity.split(",")[2]
    with closing(ScpiGenerator(replace(bench.driver.config, serial=own))) as right:
        right.open()
    with pytest.raises(InstrumentAbsent, match=f"{own}.* answers, which is no .* serial number MY00000007"):
        ScpiGenerator(replace(bench.driver.config, serial="MY00000007")).open()
    assert not bench.instrument.heard["*RST"]


def test_a_foreign_server_that_says_nothing(bench: Bench) -> None:
    bench.driver.open()
    bench.instrument.mute.add("OUTP?")
    with pytest.raises(InstrumentSilent, match=r"no answer to OUTP\? within 0\.5 s"):
        bench.driver.off()


def test_a_foreign_server_that_hangs_up(bench: Bench) -> None:
    bench.driver.open()
    bench.driver.arm_sine(20.0, 0.5, 0.0, triggered=False)
    bench.instrument.fatal.add("VOLT")
    with pytest.raises(DeviceLost, match="the connection is lost"):
        bench.driver.set_amplitude(1.0)
