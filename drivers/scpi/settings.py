"""The settings of a 33220A that rattle uses: command, unit, range, and where the manual says so.

Sections are those of the Agilent 33220A User's Guide (33220-90002), chapter 4, "Remote Interface Reference".
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

from daq.quantity import Check, Key, Quantity, Text
from drivers.scpi import answers

_LOOPBACK = ("TCPIP::127.0.0.1::", "TCPIP0::127.0.0.1::", "TCPIP::localhost::", "ASRL")


def _reachable(generator: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    resource = generator["resource"]
    if not resource and not generator["emulated"]:
        yield "resource", "the generator's VISA address, or emulated = true"
    if generator["emulated"] and resource and not resource.startswith(_LOOPBACK):
        yield "resource", "127.0.0.1 (an emulated instrument listens on loopback only)"


@dataclass(frozen=True, slots=True)
class GeneratorSettings:
    """The table [signal_generator] of a bench: where the generator is and how far it may go.

    `force_per_volt` in N/V is what amplifier and shaker make of a volt at the drive point, where
    `maximum_amplitude` in N bounds |offset| plus peak. `resource` is empty where nobody knows it yet.
    """

    force_per_volt: Annotated[float, Quantity("N/V", 0.001, 1000)]
    maximum_amplitude: Annotated[float, Quantity("N", 0, 1000, above=True)]
    driver: Annotated[Literal["scpi_33220a"], Key()] = "scpi_33220a"
    resource: Annotated[
        str,
        Text(
            'a VISA address, such as "TCPIP::192.168.0.5::5025::SOCKET"',
            r"(TCPIP\d*::.+::(SOCKET|INSTR)|ASRL.+::INSTR|USB\d*::.+::INSTR|GPIB\d*::.+::INSTR)",
        ),
    ] = ""
    emulated: Annotated[bool, Key()] = False
    name: str = "signal generator"
    timeout_s: float = 2.0
    CHECKS: ClassVar = (Check(("resource", "emulated"), _reachable),)

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        """What the table says of one that is at `address`."""
        return {"resource": address}

    def at(self, address: str) -> GeneratorSettings:
        """The same one, at `address`."""
        return replace(self, resource=address)

    @property
    def maximum_amplitude_v(self) -> float:
        """The largest |offset| plus peak in V, at its output into high impedance."""
        return self.maximum_amplitude / self.force_per_volt


@dataclass(frozen=True, slots=True)
class Number:
    """A setting with a number: its command and range in `unit`, and how exactly the instrument keeps it."""

    name: str
    command: str
    unit: str
    minimum: float
    maximum: float
    absolute: float
    relative: float
    section: str

    def text(self, value: float) -> str:
        """Return `value` as the instrument reads it."""
        return f"{value:.10g}"

    def allows(self, value: float) -> bool:
        """Whether the instrument can be set to `value`; NaN never."""
        return self.minimum <= value <= self.maximum

    def agrees(self, value: float, answer: str) -> bool:
        """Whether the instrument kept `value`, within its resolution; ValueError for no number."""
        return math.isclose(value, answers.number(answer), rel_tol=self.relative, abs_tol=self.absolute)


@dataclass(frozen=True, slots=True)
class Choice:
    """A setting with a word (or ON, OFF, INF) and what the instrument answers to its query then."""

    name: str
    command: str
    word: str
    answer: str
    section: str

    def agrees(self, answer: str) -> bool:
        """Whether the instrument kept the word."""
        if answer.strip().upper() == self.answer:
            return True
        try:
            return answers.number(answer) == answers.number(self.answer)
        except ValueError:
            return False


_OUTPUT = "Output Configuration Commands"
_BURST = "Burst Mode Commands"

# Ranges are those into an open circuit; amplitudes are kept to 4 digits, frequencies to 1 uHz.
FREQUENCY = Number("frequency", "FREQ", "Hz", 1e-6, 20e6, 1e-6, 1e-9, _OUTPUT)
AMPLITUDE = Number("amplitude", "VOLT", "Vpp", 0.02, 20.0, 1e-4, 5e-4, _OUTPUT)
OFFSET = Number("offset", "VOLT:OFFS", "V", -10.0, 10.0, 1e-3, 5e-4, _OUTPUT)

SINE = Choice("waveform", "FUNC", "SIN", "SIN", _OUTPUT)
OPEN_CIRCUIT = Choice("output load", "OUTP:LOAD", "INF", "9.9E37", _OUTPUT)
PEAK_TO_PEAK = Choice("amplitude unit", "VOLT:UNIT", "VPP", "VPP", _OUTPUT)
OUTPUT_ON = Choice("output", "OUTP", "ON", "1", _OUTPUT)
OUTPUT_OFF = Choice("output", "OUTP", "OFF", "0", _OUTPUT)
TRIGGERED_BURST = (
    Choice("burst mode", "BURS:MODE", "TRIG", "TRIG", _BURST),
    Choice("trigger source", "TRIG:SOUR", "BUS", "BUS", "Triggering Commands"),  # before an infinite count
    Choice("burst count", "BURS:NCYC", "INF", "9.9E37", _BURST),
    Choice("burst phase", "BURS:PHAS", "0", "0", _BURST),
    Choice("burst", "BURS:STAT", "ON", "1", _BURST),
)
