"""The DC supply's driver over VISA on a TCP socket, to a server that we did not write: sinstruments.

Socket, lines and clients are the package's; the table of settings below is ours, in the short forms of the
N6900/N7900 guide, chapter 6.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

import pytest

from daq.errors import DeviceLost, InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.scpi.supply import ScpiSupply
from drivers.scpi.supply_settings import SupplySettings

simulator = pytest.importorskip("sinstruments.simulator")
serving = pytest.importorskip("sinstruments.pytest")

IDENTITY = "Keysight Technologies,N7972A,MY54000001,B.03.02.1232"
AFTER_RESET = {
    "VOLT": "+0.000000E+00",
    "VOLT:PROT": "+4.800000E+01",
    "VOLT:SLEW": "+9.900000E+37",
    "CURR": "+5.000000E-01",
    "OUTP": "0",
    "OUTP:PROT:WDOG": "0",
    "OUTP:PROT:WDOG:DEL": "60",
}
CONDITIONS = {"STAT:OPER:COND": "+1", "STAT:QUES:COND": "+0", "SYST:ERR": '+0,"No error"', "*OPC": "1"}


class SupplyN7972A(simulator.BaseDevice):  # type: ignore[misc, name-defined]
    """40 V, 50 A. Keeps settings but those it `clips`; `mute` gets no answer, `fatal` ends the line."""

    def __init__(self, name: str, **keys: Any) -> None:
        super().__init__(name, **keys)
        self.identity = IDENTITY
        self.kept = dict(AFTER_RESET)
        self.heard: Counter[str] = Counter()
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
            return self._answer(header[:-1], parameter)
        if header == "*RST":
            self.kept = dict(AFTER_RESET)
        elif header in self.kept:
            words = {"ON": "1", "OFF": "0"}
            kept = words.get(parameter) or f"{float(parameter):+.6E}"
            self.kept[header] = self.clips.get(header, kept)
        return None

    def _answer(self, header: str, parameter: str) -> bytes:
        volts = self.kept["VOLT"] if self.kept["OUTP"] == "1" else "+1.2E-03"
        most = {"VOLT": "+4.080000E+01", "CURR": "+5.100000E+01"}
        answers = {
            "*IDN": self.identity,
            "MEAS:VOLT": volts,
            "MEAS:CURR": "+1.1E+00",
            **CONDITIONS,
            **self.kept,
        }
        return (most[header] if parameter == "MAX" else answers[header]).encode("ascii") + b"\n"


class Bench:
    """The foreign server with its instrument, and our driver, not open yet."""

    def __init__(self) -> None:
        device = {
            "name": "supply",
            "package": __name__,
            "class": SupplyN7972A.__name__,
            "transports": [{"type": "tcp", "url": "127.0.0.1:0"}],
        }
        self.server = serving.server_context({"devices": [device]})
        self.server.start()
        self.instrument: SupplyN7972A = self.server.server.devices["supply"]
        host, port = self.instrument.transports[0].address
        settings = SupplySettings(10.0, 300.0, 5.0, timeout_s=0.5)
        self.driver = ScpiSupply(settings.at(f"TCPIP::{host}::{port}::SOCKET"))


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.driver.close()
    bench.server.stop()


def test_a_foreign_server_is_set_started_watched_and_switched_off(bench: Bench) -> None:
    driver, instrument = bench.driver, bench.instrument
    driver.open()
    assert driver.identity == IDENTITY
    driver.arm(100.0)
    assert instrument.kept["OUTP"] == "0"
    driver.start()
    driver.set_speed(200.3)
    for _ in range(16):
        driver.check()
    shown = {key: float(value) for key, value in instrument.kept.items()}
    assert shown == {
        "VOLT": 20.03,
        "VOLT:PROT": 33.0,
        "VOLT:SLEW": 10.0,
        "CURR": 5.0,
        "OUTP": 1.0,
        "OUTP:PROT:WDOG": 1.0,
        "OUTP:PROT:WDOG:DEL": 2.0,
    }
    assert (driver.read().speed_rpm, driver.read().output_current_a) == (pytest.approx(200.3), 1.1)
    driver.off()
    assert instrument.kept["OUTP"] == "0"


def test_what_a_foreign_server_keeps_otherwise_is_no_setting(bench: Bench) -> None:
    bench.instrument.clips["CURR"] = "+4.000000E+00"
    bench.driver.open()
    with pytest.raises(InstrumentRefused, match=r"current limit = 5 A reads back \+4\.0+E\+00"):
        bench.driver.arm(100.0)
    assert bench.instrument.kept["OUTP"] == "0"


def test_another_instrument_on_a_foreign_server(bench: Bench) -> None:
    bench.instrument.identity = "Agilent Technologies,N5747A,US06N5747K,B.00.01"
    with pytest.raises(
        InstrumentAbsent, match=r"N5747A.* answers, which is no supply of the N6900 or N7900 series"
    ):
        bench.driver.open()


def test_another_of_the_same_model_is_not_driven(bench: Bench) -> None:
    own = bench.instrument.identity.split(",")[2]
    with closing(ScpiSupply(replace(bench.driver.config, serial=own))) as right:
        right.open()
    with pytest.raises(InstrumentAbsent, match=f"{own}.* answers, which is no .* serial number MY00000007"):
        ScpiSupply(replace(bench.driver.config, serial="MY00000007")).open()
    assert not bench.instrument.heard["*RST"]


def test_a_foreign_server_that_says_nothing(bench: Bench) -> None:
    bench.driver.open()
    bench.instrument.mute.add("OUTP?")
    with pytest.raises(InstrumentSilent, match=r"no answer to OUTP\? within 0\.5 s"):
        bench.driver.off()
    assert bench.instrument.heard["OUTP"] == 1  # sent all the same


def test_a_foreign_server_that_hangs_up(bench: Bench) -> None:
    bench.driver.open()
    bench.driver.arm(100.0)
    bench.instrument.fatal.add("VOLT")
    with pytest.raises(DeviceLost, match="the connection is lost"):
        bench.driver.set_speed(200.0)
