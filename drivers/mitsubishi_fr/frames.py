"""Modbus RTU frames as bytes: requests, and the answer that belongs to each, wherever it lies among others.

Modbus over Serial Line V1.02, section 2.5; Modbus Application Protocol V1.1b3, sections 6.3, 6.6, 7.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum

from pymodbus.framer.rtu import FramerRTU

READ, WRITE = 0x03, 0x06  # holding registers; a single register
_EXCEPTION = 0x80  # added to the function of a request that is refused
_EXCEPTION_LENGTH = 5  # bytes: station, function, code, CRC
_SHORTEST = 4  # bytes: station, function, CRC


@dataclass(frozen=True, slots=True)
class Request:
    """A request to one station: read `content` registers from `address` on, or write `content` into it."""

    station: int
    function: int
    address: int
    content: int

    @property
    def shape(self) -> tuple[int, int]:
        """What tells the answer from that to another request: function and length."""
        return self.function, self.answer_length

    @property
    def answer_length(self) -> int:
        """Bytes of a good answer."""
        return 5 + 2 * self.content if self.function == READ else 8

    def frame(self) -> bytes:
        """Return the request as it goes on the line."""
        body = struct.pack(">BBHH", self.station, self.function, self.address, self.content)
        return body + checksum(body)


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a request: registers that were read, or the code of an exception (0 for none)."""

    frame: bytes
    registers: tuple[int, ...] = ()
    exception: int = 0


class Heard(Enum):
    """What was on the line where no answer was found."""

    NOTHING = "nothing"
    BAD_CRC = "a frame with a wrong CRC"
    OTHER_STATION = "another station's frame"
    OTHER_ANSWER = "the answer to another request"
    ECHO = "the request itself"
    GARBAGE = "garbage"


def checksum(body: bytes) -> bytes:
    """Return the CRC-16 of a frame's bytes as it is sent, low byte first."""
    # pymodbus returns it with its bytes changed round already, so that "big" puts the low one first
    return FramerRTU.compute_CRC(body).to_bytes(2, "big")


def intact(frame: bytes) -> bool:
    """Whether the bytes are one frame with a good CRC."""
    return len(frame) >= _SHORTEST and checksum(frame[:-2]) == frame[-2:]


def find_answer(request: Request, heard: bytes) -> Answer | None:
    """Return the answer to `request` among all bytes heard since it was sent, None where it is not there.

    Garbage, half frames, answers of other stations or to other requests, and the echo of a read are passed
    over. The echo of a write is the same as its answer: a write counts as done only once it is read back.
    """
    for start in range(len(heard)):
        for length in (request.answer_length, _EXCEPTION_LENGTH):
            frame = heard[start : start + length]
            if len(frame) == length and _belongs(request, frame) and intact(frame):
                if frame[1] & _EXCEPTION:
                    return Answer(frame, exception=frame[2])
                registers = frame[3:-2] if request.function == READ else b""
                return Answer(frame, struct.unpack(f">{len(registers) // 2}H", registers))
    return None


def what_was_heard(request: Request, heard: bytes) -> Heard:
    """Say what was on the line instead of the answer."""
    if not heard:
        return Heard.NOTHING
    if any(_belongs(request, heard[start:]) for start in range(len(heard))):
        return Heard.BAD_CRC
    if request.frame() in heard:
        return Heard.ECHO
    for start in range(len(heard) - _SHORTEST + 1):
        # An exception, a write's answer, a read's answer of as many bytes as it says it has.
        for length in {_EXCEPTION_LENGTH, 8, 5 + heard[start + 2]}:
            frame = heard[start : start + length]
            if len(frame) == length and intact(frame):
                return Heard.OTHER_ANSWER if frame[0] == request.station else Heard.OTHER_STATION
    return Heard.GARBAGE


def _belongs(request: Request, frame: bytes) -> bool:
    if len(frame) < 3 or frame[0] != request.station:
        return False
    if frame[1] == request.function | _EXCEPTION:
        return True
    if frame[1] != request.function:
        return False
    if request.function == READ:
        return frame[2] == 2 * request.content
    # A write is answered by a copy of itself: address and value.
    return frame[2:6] == request.frame()[2:6]
