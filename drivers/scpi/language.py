"""What all that speak SCPI have in common: where they are reached, how answers are read, what a setting is.

Answers are taken apart by IEEE 488.2-1992 section 8 and SCPI-1999 volume 1 section 7.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from daq.quantity import Check, Text

_LOOPBACK = ("TCPIP::127.0.0.1::", "TCPIP0::127.0.0.1::", "TCPIP::localhost::", "ASRL")
MOVING_S = 0.5
"""While it drives, a longer silence is a lost link, and a later order to begin one that nobody guards."""
IDENTITY = "*IDN?"
INFINITY = 9.9e37  # SCPI-1999 volume 1, 7.2.1.4: how infinity is written
_NUMBER = re.compile(r"[+-]?(\d{1,40}(\.\d{0,40})?|\.\d{1,40})([eE][+-]?\d{1,3})?")
_ERROR = re.compile(r'([+-]?\d{1,6})\s*(?:,\s*"?([^"]{0,300}).*)?', re.DOTALL)


def reachable(what: str) -> Check:
    """A place for a real one, called `what`, and loopback for an emulated one."""

    def wrong(source: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        resource = source["resource"]
        if not resource and not source["emulated"]:
            yield "resource", f"the {what}'s VISA address, or emulated = true"
        if source["emulated"] and resource and not resource.startswith(_LOOPBACK):
            yield "resource", "127.0.0.1 (an emulated instrument listens on loopback only)"

    return Check(("resource", "emulated"), wrong)


VISA_ADDRESS = Text(
    'a VISA address, such as "TCPIP::192.168.0.5::5025::SOCKET"',
    r"(TCPIP\d*::.+::(SOCKET|INSTR)|ASRL.+::INSTR|USB\d*::.+::INSTR|GPIB\d*::.+::INSTR)",
)

SERIAL = Text("the serial number that it answers to *IDN?")


def longest_off_s(resource: str) -> float:
    """How long an off may take before another connection helps, s; nothing over a network.

    Any other line has one user at a time: a second one would garble the off of the first, which may wait
    for an exchange and is one itself.
    """
    return 0.0 if resource.startswith("TCPIP") else 2 * MOVING_S


def takes_several(resource: str) -> bool:
    """Whether a second connection may speak while the first does: at a socket, not behind a line or a bus."""
    return resource.startswith("TCPIP") and resource.endswith("::SOCKET")


def number_in(answer: str) -> float:
    """Return the number in an answer, 9.9E37 as infinity; ValueError for anything else, NaN included."""
    text = answer.strip()
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"not a number: {text[:60]!r}")
    value = float(text)
    return math.copysign(math.inf, value) if abs(value) >= INFINITY else value


def error_in(answer: str) -> tuple[int, str]:
    """Return code and text of an answer to SYST:ERR?; ValueError where it is none."""
    match = _ERROR.fullmatch(answer.strip())
    if match is None:
        raise ValueError(f"not an entry of an error queue: {answer.strip()[:60]!r}")
    return int(match[1]), (match[2] or "").strip()


def model_in(answer: str) -> str:
    """Return the model in an answer to *IDN? (maker, model, serial, firmware); empty where there is none."""
    return _field(answer, 1)


def serial_in(answer: str) -> str:
    """Return the serial number in an answer to *IDN?; empty where there is none."""
    return _field(answer, 2)


def _field(identity: str, number: int) -> str:
    fields = identity.split(",")
    return fields[number].strip() if number < len(fields) else ""


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
        return math.isclose(value, number_in(answer), rel_tol=self.relative, abs_tol=self.absolute)


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
            return number_in(answer) == number_in(self.answer)
        except ValueError:
            return False


_OUTPUT = "SCPI-1999 volume 2, chapter 13, OUTPut"
OUTPUT_ON = Choice("output", "OUTP", "ON", "1", _OUTPUT)
OUTPUT_OFF = Choice("output", "OUTP", "OFF", "0", _OUTPUT)
