"""Holding registers of a Mitsubishi FR inverter that rattle uses: number, scale, unit, access, and the page.

Pages are those of the FR-D700 Instruction Manual (Applied), IB(NA)-0600366ENG, section 4.19.6. "D": the page
is quoted by two or more public register maps; "M": known from memory of the manual only.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

FIRST_NUMBER = 40001  # the manual's register number of wire address 0
PARAMETERS = 41000  # Pr.n is register 41000 + n
LONGEST_READ = 125  # Modbus Application Protocol V1.1b3, section 6.3


@dataclass(frozen=True, slots=True)
class Register:
    """One holding register: its number in the manual, and value = raw * `scale` in `unit`."""

    number: int
    name: str
    scale: float = 1.0
    unit: str = ""
    writable: bool = False
    page: str = "p. 210 (D)"

    @property
    def address(self) -> int:
        """Its address on the wire."""
        return self.number - FIRST_NUMBER

    def value(self, raw: int) -> float:
        """Return what the raw register says, in `unit`."""
        return raw * self.scale

    def raw(self, value: float) -> int:
        """Return the nearest raw value; ValueError outside 16 bits and for NaN."""
        if not 0.0 <= value <= 65535 * self.scale:
            raise ValueError(f"{self} = {value:g} {self.unit} does not fit into 16 bits")
        return round(value / self.scale)

    def __str__(self) -> str:
        return f"{self.number} ({self.name}, {self.page})"


@dataclass(frozen=True, slots=True)
class Block:
    """Registers that are read in one request; ValueError unless all of them lie in one declared range.

    A drive answers 0, and no error, for a register that it lacks between two that it has: a read may never
    cross a hole.
    """

    first: int
    count: int

    def __post_init__(self) -> None:
        last = self.first + self.count - 1
        whole = any(self.first in run and last in run for run in RANGES)
        if not (whole and 0 < self.count <= LONGEST_READ):
            raise ValueError(f"registers {self.first} to {last} are not within one declared range")

    @property
    def address(self) -> int:
        """Its address on the wire."""
        return self.first - FIRST_NUMBER

    @property
    def registers(self) -> tuple[Register, ...]:
        """What it reads, in order."""
        return tuple(REGISTERS[number] for number in range(self.first, self.first + self.count))

    def __str__(self) -> str:
        first, last = self.registers[0], self.registers[-1]
        return str(first) if self.count == 1 else f"{first.number} to {last}"


class Status(IntFlag):
    """Register 40009 when read (p. 210, bits after the first: M, the same in FR-F700, H79)."""

    RUNNING = 1
    FORWARD = 2
    REVERSE = 4
    UP_TO_FREQUENCY = 8
    OVERLOAD = 16
    FAULT_OUTPUT = 128
    FAULT = 32768


class Command(IntFlag):
    """Register 40009 when written (p. 210, D; MRS: M)."""

    STOP = 1
    FORWARD = 2
    REVERSE = 4
    OUTPUT_SHUT_OFF = 512  # the motor coasts: no stop of ours uses it


class Terminal(IntFlag):
    """Register 40215: which input terminals are on (place and bits: M, as in FR-A700 and FR-E700)."""

    STF = 1
    STR = 2
    RL = 16
    RM = 32
    RH = 64


# Register 40010 (p. 210, D; values M): what is written to choose a mode, and how it reads then.
CHOOSE_PANEL, CHOOSE_NETWORK = 0x11, 0x14
PANEL_MODE, NETWORK_MODE = 1, 4

INVERTER_RESET = Register(40002, "inverter reset", writable=True)
STATUS_AND_COMMAND = Register(40009, "inverter status, control input", writable=True)
OPERATION_MODE = Register(40010, "operation mode", writable=True)
RUNNING_FREQUENCY = Register(40014, "running frequency, RAM", 0.01, "Hz", writable=True)
OUTPUT_FREQUENCY = Register(40201, "output frequency", 0.01, "Hz")
OUTPUT_CURRENT = Register(40202, "output current", 0.01, "A", page="p. 211 (M)")
OUTPUT_VOLTAGE = Register(40203, "output voltage", 0.1, "V", page="p. 211 (M)")
INPUT_TERMINALS = Register(40215, "input terminal status", page="p. 211 (M)")
FAULTS = tuple(Register(40501 + n, f"fault history {n + 1}", page="p. 212 (D)") for n in range(8))


def _parameter(
    number: int, name: str, scale: float = 1.0, unit: str = "", page: str = "p. 210 (D)"
) -> Register:
    return Register(PARAMETERS + number, f"Pr.{number} {name}", scale, unit, writable=True, page=page)


MAXIMUM_FREQUENCY = _parameter(1, "maximum frequency", 0.01, "Hz")
ACCELERATION_TIME = _parameter(7, "acceleration time", 0.1, "s")
DECELERATION_TIME = _parameter(8, "deceleration time", 0.1, "s")
RAMP_REFERENCE = _parameter(20, "acceleration/deceleration reference frequency", 0.01, "Hz")
OPERATION_MODE_SELECTION = _parameter(79, "operation mode selection")
STATION = _parameter(117, "PU communication station number")
BAUDRATE = _parameter(118, "PU communication speed", 100.0, "bit/s")
STOP_BITS = _parameter(119, "PU communication stop bit length")
PARITY = _parameter(120, "PU communication parity check")
WATCHDOG = _parameter(122, "PU communication check time interval", 0.1, "s")
STOP_SELECTION = _parameter(250, "stop selection", 0.1, "s", "M")
START_MODE = _parameter(340, "communication start-up mode selection")
ON_SILENCE = _parameter(502, "stop mode selection at communication error")
PROTOCOL = _parameter(549, "protocol selection")
TERMINAL_FUNCTIONS = {
    terminal: _parameter(number, f"{terminal} terminal function selection", page="M")
    for number, terminal in enumerate(("STF", "STR", "RL", "RM", "RH"), 178)
}

_DECLARED = [each for each in globals().values() if isinstance(each, Register)]
REGISTERS = {register.number: register for register in (*_DECLARED, *FAULTS, *TERMINAL_FUNCTIONS.values())}

# Runs of consecutive numbers, only of what is in the table: a register that nobody declared ends a range.
# 40002 cannot be read.
_READABLE = sorted(number for number in REGISTERS if number != INVERTER_RESET.number)
_FIRST = [number for number in _READABLE if number - 1 not in _READABLE]
_LAST = [number for number in _READABLE if number + 1 not in _READABLE]
RANGES = tuple(range(first, last + 1) for first, last in zip(_FIRST, _LAST, strict=True))


def block(*registers: Register) -> Block:
    """Return the block from the first to the last of consecutive registers."""
    return Block(registers[0].number, registers[-1].number - registers[0].number + 1)


# The exchange before any of these has an answer of another length, see `conversation`; without the terminals
# the two before have.
STATUS_BLOCK = block(STATUS_AND_COMMAND, OPERATION_MODE)
MONITOR_BLOCK = block(OUTPUT_FREQUENCY, OUTPUT_VOLTAGE)
SET_BLOCK = block(RUNNING_FREQUENCY)
TERMINAL_BLOCK = block(INPUT_TERMINALS)
LAST_FAULT_BLOCK = block(FAULTS[0])
MARKS = tuple(block(FAULTS[0], FAULTS[last]) for last in range(4, 8))

# FR-D700 manual, chapter 5, "List of fault displays" and data codes of the fault history (M).
FAULT_NAMES = {
    0x10: "E.OC1",
    0x11: "E.OC2",
    0x12: "E.OC3",
    0x20: "E.OV1",
    0x21: "E.OV2",
    0x22: "E.OV3",
    0x30: "E.THT",
    0x31: "E.THM",
    0x40: "E.FIN",
    0x52: "E.ILF",
    0x60: "E.OLT",
    0x70: "E.BE",
    0x80: "E.GF",
    0x81: "E.LF",
    0x90: "E.OHT",
    0x91: "E.PTC",
    0xB0: "E.PE",
    0xB1: "E.PUE",
    0xB2: "E.RET",
    0xC0: "E.CPU",
    0xC4: "E.CDO",
    0xC5: "E.IOH",
    0xC7: "E.AIE",
}
COMMUNICATION_FAULT = 0xB1


def fault_name(code: int) -> str:
    """Return what the drive's display shows for a code of its fault history; empty for 0."""
    low = code & 0xFF
    return "" if low == 0 else FAULT_NAMES.get(low, f"fault H{low:02X}")
