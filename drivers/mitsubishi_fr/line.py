"""The serial line to one inverter: a request out, its answer or nothing back, each within a deadline.

Bytes go through pymodbus's asyncio client; none of its exceptions leaves this module. The client takes any
frame of the right station for the answer, so it is shown only the frame that `frames` has found to be it.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import termios
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ModbusException

from daq.errors import DeviceLost, InstrumentAbsent
from drivers.mitsubishi_fr.frames import READ, Answer, Heard, Request, find_answer, what_was_heard
from drivers.mitsubishi_fr.settings import InverterSettings

BITS_PER_CHARACTER = 11  # start, 8 data, parity or a second stop bit, stop
SHORTEST_GAP_S = 0.00175  # Modbus over Serial Line V1.02, 2.5.1.1: 3.5 characters, 1.75 ms above 19200 bit/s
DEGRADED_ABOVE = 5
DEGRADED_WITHIN_S = 10.0  # a line that is worse than this is told to the operator; nothing is stopped for it

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # else its errors go to standard error


class NoAnswer(Exception):
    """Nobody answered a request in time; says what was heard instead."""

    def __init__(self, heard: Heard) -> None:
        self.heard = heard
        super().__init__(f"heard {heard.value}")


@dataclass(slots=True)
class LineHealth:
    """Counts what went wrong on a line. `monotonic_s` gives the time in s."""

    monotonic_s: Callable[[], float]
    asked: int = 0
    unanswered: int = 0
    crc_errors: int = 0
    resynchronised: int = 0
    _recent_s: deque[float] = field(default_factory=deque)

    def note_failure(self, heard: Heard) -> None:
        """Count a request without its answer."""
        self.unanswered += 1
        self.crc_errors += heard is Heard.BAD_CRC
        self._recent_s.append(self.monotonic_s())

    @property
    def degraded(self) -> bool:
        """Whether more than 5 requests failed within the last 10 s."""
        oldest_s = self.monotonic_s() - DEGRADED_WITHIN_S
        while self._recent_s and self._recent_s[0] < oldest_s:
            self._recent_s.popleft()
        return len(self._recent_s) > DEGRADED_ABOVE


class Line(Protocol):
    """What a conversation needs of a line."""

    health: LineHealth

    async def ask(self, request: Request) -> Answer:
        """Send once and return the answer. Raises `NoAnswer`, `DeviceLost`."""

    async def reopen(self) -> bool:
        """Connect anew where the connection is lost; whether it was. Raises `InstrumentAbsent`."""


class SerialLine:
    """A `Line` on a port that whoever opens it has locked. Not safe for two requests at once."""

    def __init__(self, settings: InverterSettings, monotonic_s: Callable[[], float]) -> None:
        self._settings = settings
        self.health = LineHealth(monotonic_s)
        self._client: AsyncModbusSerialClient | None = None
        self._socket: socket.socket | None = None
        self._asked: Request | None = None
        self._answer: Answer | None = None
        self._heard = b""

    async def open(self) -> None:
        """Take the port. Raises `InstrumentAbsent`."""
        settings = self._settings
        self._client = AsyncModbusSerialClient(
            settings.port,
            baudrate=settings.baudrate,
            parity=settings.parity,
            stopbits=2 if settings.parity == "N" else 1,
            timeout=settings.answer_s,  # pymodbus's own 3 s would outlast the drive's watchdog
            retries=0,  # what may be repeated, the conversation knows
            reconnect_delay=0,  # a device that comes back is a matter for a person, or for a stop
            trace_packet=self._trace,
        )
        try:
            connected = await self._client.connect()
        except (OSError, ValueError, termios.error, ModbusException) as error:
            self.close()
            raise self._absent(str(error)) from error
        if not connected:
            self.close()
            raise self._absent("the port does not open")
        port = getattr(getattr(self._client.ctx.transport, "sync_serial", None), "_socket", None)
        self._socket = port if isinstance(port, socket.socket) else None

    async def reopen(self) -> bool:
        if self._client is not None and self._client.connected:
            return False
        self.close()
        await self.open()
        return True

    def close(self) -> None:
        """Give the port back. Never raises."""
        if self._client is not None:
            client, self._client = self._client, None
            client.close()
        if self._socket is not None:
            self._socket.close()  # pyserial leaves one open that the other end has closed
            self._socket = None

    async def ask(self, request: Request) -> Answer:
        """Send once, when the line has been quiet for a gap, and return the answer."""
        client = await self._quiet_client()
        self._asked, self._answer, self._heard = request, None, b""
        self.health.asked += 1
        try:
            if request.function == READ:
                await client.read_holding_registers(
                    request.address, count=request.content, device_id=request.station
                )
            else:
                await client.write_register(request.address, request.content, device_id=request.station)
        except ModbusException as error:  # a spoilt answer is none to pymodbus: it waits out the timeout
            if not client.connected:
                raise self._lost(str(error)) from error
        except OSError as error:
            raise self._lost(str(error)) from error
        finally:
            self._asked = None
        if self._answer is None:
            heard = what_was_heard(request, self._heard)
            self.health.note_failure(heard)
            raise NoAnswer(heard)
        return self._answer

    async def _quiet_client(self) -> AsyncModbusSerialClient:
        """Let what is still on its way come in, where nobody asked for it, and be dropped."""
        # Frames on an RTU line end with silence: a request that comes too early is none.
        await asyncio.sleep(max(3.5 * BITS_PER_CHARACTER / self._settings.baudrate, SHORTEST_GAP_S))
        client = self._client
        if client is None:
            raise self._lost("the connection is closed")
        if not client.connected:
            raise self._lost("the port went away")
        return client

    def _trace(self, sending: bool, data: bytes) -> bytes:
        """Hand through what is sent; of all that came since the request, only its answer."""
        if sending:
            return data
        if self._asked is None or self._answer is not None:
            return b""
        self._heard = data
        self._answer = find_answer(self._asked, data)
        if self._answer is None:
            return b""
        # The answer was found among other bytes.
        self.health.resynchronised += len(data) > len(self._answer.frame)
        return self._answer.frame

    def _absent(self, why: str) -> InstrumentAbsent:
        check = "cable, power, that no other program uses the port, and port in the bench file"
        return InstrumentAbsent(self._settings.name, self._settings.port, f"nobody answers ({why})", check)

    def _lost(self, why: str) -> DeviceLost:
        return DeviceLost(
            self._settings.name, self._settings.port, f"the connection is lost ({why})", "cable and power"
        )
