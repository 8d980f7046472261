"""Serves an emulated drive on TCP and on a pty, as RTU frames through pymodbus's server, over a line that may
be disturbed."""

from __future__ import annotations

import asyncio
import math
import os
import pty
import tty
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import NoSuchIdException
from pymodbus.framer import FramerType
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.mitsubishi_fr.emulator.drive import DriveFaults, EmulatedDrive, Unanswered
from drivers.mitsubishi_fr.emulator.line_faults import KINDS, Disturbance, LineFaults
from drivers.mitsubishi_fr.frames import WRITE, intact
from drivers.mitsubishi_fr.registers import FIRST_NUMBER, RUNNING_FREQUENCY
from drivers.rehearsal import Rehearsal, Rehearsed

REGISTERS = 2000  # 40001 to 42000: all that an FR-D700 has; the drive says which of them it really has
SETTLE_S = 0.01  # what was due happens at its own time, however late it is looked at
TIMER_RESOLUTION_S = 1e-6  # s; `call_at` may come a clock's step early
_REQUEST_LENGTH = 8  # both of a read and of a write of one register


class InverterServer:
    """Answers on 127.0.0.1 and on a pty until `stop`.

    What comes through `rehearsal` (`Rehearsed`, `LineFaults`) goes wrong from then on, what is `rehearsed` at
    its time since the motor was first told to turn.
    """

    def __init__(
        self,
        drive: EmulatedDrive,
        station: int,
        line: LineFaults,
        rehearsal: Connection | None = None,
        rehearsed: tuple[Rehearsed, ...] = (),
    ) -> None:
        self.drive, self._station, self._rehearsal = drive, station, rehearsal
        self.disturbance = Disturbance(line)
        self._to_come, self._used_s = Rehearsal(rehearsed), math.inf
        self._loop = asyncio.new_event_loop()
        self._stopped = asyncio.Event()
        self._wires: list[_Wire] = []
        self._written = 0  # what the last write wrote, for its answer
        self._modbus: ModbusTcpServer
        self._listener: asyncio.Server
        self._pty = (-1, -1)  # master, slave

    def open(self) -> tuple[str, str]:
        """Open both ways in; return them as pyserial wants them, TCP first."""
        return self._loop.run_until_complete(self._open())

    def serve(self) -> None:
        """Answer until `stop` is called."""
        self._loop.run_until_complete(self._serve())

    def stop(self) -> None:
        """End `serve`; may be called by any thread."""
        self._loop.call_soon_threadsafe(self._stopped.set)

    def close(self) -> None:
        self._loop.run_until_complete(self._close())
        self._loop.close()

    async def _open(self) -> tuple[str, str]:
        drive = SimDevice(self._station, _registers(), action=self._access)
        # Without this one pymodbus 3.16 answers for every unknown station with exception 4.
        others = SimDevice(0, _registers(), action=_nobody)
        # It never listens itself: the wires feed its request handlers.
        self._modbus = ModbusTcpServer(
            [drive, others], framer=FramerType.RTU, address=("127.0.0.1", 0), ignore_missing_devices=True
        )
        self._listener = await self._loop.create_server(lambda: _TcpClient(self), "127.0.0.1", 0)
        # The slave stays open here: without it a read of the master fails once a client has gone.
        self._pty = master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        wire = self.new_wire(lambda data: _write(master, data))
        self._loop.add_reader(master, lambda: wire.heard(_read(master)))
        if self._rehearsal is not None:
            self._loop.add_reader(self._rehearsal.fileno(), self._rehearse, self._rehearsal)
        port = self._listener.sockets[0].getsockname()[1]
        return f"socket://127.0.0.1:{port}", os.ttyname(slave)

    async def _serve(self) -> None:
        while not self._stopped.is_set():
            self.drive.settle()
            if self.drive.output.target > 0.0:
                self._used_s = min(self._used_s, self._loop.time())  # the first time alone
            for fault in self._to_come.due(self._loop.time() - self._used_s):
                self.befall(fault)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stopped.wait(), SETTLE_S)

    async def _close(self) -> None:
        master, slave = self._pty
        self._loop.remove_reader(master)
        if self._rehearsal is not None:
            self._loop.remove_reader(self._rehearsal.fileno())
        self._listener.close()
        for wire in list(self._wires):
            wire.close()
        for handle in (master, slave):
            os.close(handle)
        await asyncio.sleep(0)  # lets the loop end what was closed just now

    def new_wire(self, send: Callable[[bytes], None]) -> _Wire:
        """Return a new way in; what is answered on it goes to `send`."""
        handler = self._modbus.handle_new_connection()
        wire = _Wire(self, handler.data_received, send)
        handler.connection_made(wire)
        self._wires.append(wire)
        return wire

    def forget(self, wire: _Wire) -> None:
        """Drop a way in whose client has gone."""
        if wire in self._wires:
            self._wires.remove(wire)

    async def _access(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        if values is None and function == WRITE:
            # pymodbus answers a write with what it reads back; a drive, with what was written.
            registers[address - start] = self._written
            return None
        written = None if values is None else [int(value) for value in values]
        self._written = written[-1] if written else 0
        try:
            result = self.drive.access(FIRST_NUMBER + address, count, written)
        except Unanswered as error:
            raise NoSuchIdException from error  # the one way to make this server say nothing
        if isinstance(result, ExcCodes):
            return result
        if values is None:
            registers[address - start : address - start + count] = result
        return None

    def _rehearse(self, rehearsal: Connection) -> None:
        try:
            fault = rehearsal.recv()
        except (EOFError, OSError):
            self._loop.remove_reader(rehearsal.fileno())
            return
        if isinstance(fault, LineFaults):
            self.disturbance = Disturbance(fault)
        elif isinstance(fault, DriveFaults):
            self.drive.put_faults(fault)
        else:
            self.befall(fault)

    def befall(self, fault: Rehearsed) -> None:
        kind, faults = fault.kind.replace("_", " "), self.drive.faults
        if kind in KINDS:
            self.disturbance = Disturbance(
                *self.disturbance.faults, LineFaults(fault.number("share"), (kind,))
            )
        elif kind == "trips":
            self.drive.trip(int(fault.number("code")))
        elif fault.kind == "stop_pressed":
            self.drive.press_stop()
        elif fault.kind == "set_by_another":
            self.drive.access(RUNNING_FREQUENCY.number, 1, [RUNNING_FREQUENCY.raw(fault.number("hz"))])
        elif kind == "stuck":
            self.drive.put_faults(replace(faults, stuck=True))
        elif kind == "forgets":
            forgotten = faults.not_obeyed | {int(fault.number("register"))}
            self.drive.put_faults(replace(faults, not_obeyed=forgotten))
        elif kind == "refuses":
            register, code, count = (int(fault.number(key)) for key in ("register", "code", "count"))
            exceptions = {**faults.exceptions, register: (code, count)}
            self.drive.put_faults(replace(faults, exceptions=exceptions))


class _Wire(asyncio.Transport):
    """One way in: hands requests to pymodbus, and what it answers, spoilt or not, to the client, in order."""

    def __init__(
        self, server: InverterServer, handle: Callable[[bytes], None], send: Callable[[bytes], None]
    ) -> None:
        super().__init__()
        self._server, self._handle, self._send = server, handle, send
        self._loop = asyncio.get_running_loop()
        self._request = b""
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._closed = False

    def heard(self, data: bytes) -> None:
        """Take bytes of the client."""
        if not data:
            return
        if intact(data) or intact(data[-_REQUEST_LENGTH:]):  # two may have come at once
            self._server.drive.heard_frame()
        self._request = data
        self._handle(data)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Take an answer of pymodbus."""
        piece = self._server.disturbance.spoil(self._request, bytes(data))
        at_s = self._loop.time() + piece.delay_s
        if self._waiting:
            # A line keeps the order: nothing overtakes an answer that is late.
            at_s = max(at_s, self._waiting[-1][0])
        self._waiting.append((at_s, piece.data))
        self._loop.call_at(at_s, self._flush)

    def _flush(self) -> None:
        now_s = self._loop.time() + TIMER_RESOLUTION_S
        while self._waiting and self._waiting[0][0] <= now_s and not self._closed:
            data = self._waiting.popleft()[1]
            if data:
                self._send(data)

    def close(self) -> None:
        """Send nothing more, not even what waits."""
        self._closed = True
        self._server.forget(self)


class _TcpClient(asyncio.Protocol):
    """A master on TCP."""

    def __init__(self, server: InverterServer) -> None:
        self._server = server
        self._wire: _Wire | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - a TCP server makes no other
        self._wire = self._server.new_wire(transport.write)

    def data_received(self, data: bytes) -> None:
        if self._wire is not None:
            self._wire.heard(data)

    def connection_lost(self, error: Exception | None) -> None:
        if self._wire is not None:
            self._wire.close()


def _registers() -> list[SimData]:
    return [SimData(0, count=REGISTERS, values=0, datatype=DataType.REGISTERS)]


async def _nobody(*request: object) -> ExcCodes | None:
    """Stand for every other station of the line: none of them is there."""
    raise NoSuchIdException


def _read(handle: int) -> bytes:
    try:
        return os.read(handle, 4096)
    except OSError:
        return b""


def _write(handle: int, data: bytes) -> None:
    with suppress(OSError):  # nobody has taken 64 KiB of answers: a line has no memory either
        os.write(handle, data)
