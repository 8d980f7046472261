"""The objects of a CANopen encoder that rattle uses, and how their bytes are read.

CiA 301 (version 4.2.0) is the communication profile, CiA 406 (version 3.1) that of encoders; objects are
found in both by their index.
"""

from __future__ import annotations

from dataclasses import dataclass

ROTARY = {0x0001_0196: "single-turn rotary encoder", 0x0002_0196: "multi-turn rotary encoder"}
"""Object 1000h: profile 406 in the low word, kind of encoder in the high word."""

SCALING = 0x0004
"""Bit 2 of object 6000h: whether 6001h and 6002h count, or else 6501h and 6502h."""

CYCLIC = (254, 255)
"""Transmission types of a TPDO that is sent whenever its timer elapses (CiA 301, 7.5.2.37, table 72)."""
PDO_INVALID = 0x8000_0000  # bit 31 of a COB-ID: the PDO is not sent


@dataclass(frozen=True, slots=True)
class Entry:
    """An unsigned number of `bits` in the object dictionary."""

    index: int
    subindex: int
    name: str
    bits: int
    unit: str
    profile: str
    writable: bool = False

    def __str__(self) -> str:
        return f"{self.name} ({self.index:04X}h:{self.subindex:02X})"

    def decode(self, data: bytes) -> int:
        """Return the number in `data`; ValueError unless it has this entry's length."""
        if len(data) != self.bits // 8:
            raise ValueError(f"{self} has {len(data)} bytes instead of {self.bits // 8}")
        return int.from_bytes(data, "little")

    def encode(self, value: int) -> bytes:
        """Return the bytes of `value`; OverflowError where it does not fit."""
        return value.to_bytes(self.bits // 8, "little")


DEVICE_TYPE = Entry(0x1000, 0, "device type", 32, "", "CiA 301")
HEARTBEAT_TIME = Entry(0x1017, 0, "producer heartbeat time", 16, "ms", "CiA 301", writable=True)
VENDOR = Entry(0x1018, 1, "vendor", 32, "", "CiA 301")
PRODUCT = Entry(0x1018, 2, "product code", 32, "", "CiA 301")
REVISION = Entry(0x1018, 3, "revision", 32, "", "CiA 301")
SERIAL = Entry(0x1018, 4, "serial number", 32, "", "CiA 301")
TPDO1_ID = Entry(0x1800, 1, "COB-ID of TPDO 1", 32, "", "CiA 301, 7.5.2.37")
TPDO1_TYPE = Entry(0x1800, 2, "transmission type of TPDO 1", 8, "", "CiA 301, 7.5.2.37")
TPDO1_LENGTH = Entry(0x1A00, 0, "number of objects in TPDO 1", 8, "", "CiA 301, 7.5.2.38")
OPERATING_PARAMETERS = Entry(0x6000, 0, "operating parameters", 16, "", "CiA 406", writable=True)
COUNTS_PER_REVOLUTION = Entry(
    0x6001, 0, "measuring units per revolution", 32, "counts", "CiA 406", writable=True
)
TOTAL_RANGE = Entry(0x6002, 0, "total measuring range", 32, "counts", "CiA 406", writable=True)
PRESET = Entry(0x6003, 0, "preset value", 32, "counts", "CiA 406", writable=True)
POSITION = Entry(0x6004, 0, "position value", 32, "counts", "CiA 406")
CYCLIC_TIMER = Entry(0x6200, 0, "cyclic timer", 16, "ms", "CiA 406", writable=True)
SINGLE_TURN_RESOLUTION = Entry(0x6501, 0, "single-turn resolution", 32, "counts", "CiA 406")
REVOLUTIONS = Entry(0x6502, 0, "number of distinguishable revolutions", 16, "", "CiA 406")


def tpdo1_object(number: int) -> Entry:
    """Return the entry that says which object is the `number`-th (from 1) in TPDO 1."""
    return Entry(0x1A00, number, f"object {number} in TPDO 1", 32, "", "CiA 301, 7.5.2.38")


def mapped(entry: Entry) -> int:
    """Return how a PDO mapping names an object: index, sub-index, length in bits."""
    return entry.index << 16 | entry.subindex << 8 | entry.bits


@dataclass(frozen=True, slots=True)
class PositionLayout:
    """Where the position stands in a TPDO of `length` bytes."""

    offset: int
    length: int

    @classmethod
    def of(cls, objects: tuple[int, ...]) -> PositionLayout:
        """Find 6004h among mapped objects; ValueError where it is not there or not on whole bytes."""
        if mapped(POSITION) not in objects:
            there = ", ".join(f"{value:08X}h" for value in objects) or "nothing"
            raise ValueError(f"TPDO 1 holds {there}, not the position value ({mapped(POSITION):08X}h)")
        # The lowest byte of a mapping is the object's length in bits (CiA 301, 7.5.2.38).
        before = sum(value & 0xFF for value in objects[: objects.index(mapped(POSITION))])
        total = sum(value & 0xFF for value in objects)
        if before % 8 or total % 8 or total > 64:
            raise ValueError(f"TPDO 1 has {total} bits with the position at bit {before}")
        return cls(before // 8, total // 8)

    def decode(self, data: bytes | bytearray) -> int:
        """Return the counts in a frame of the right length."""
        return int.from_bytes(data[self.offset : self.offset + 4], "little")
