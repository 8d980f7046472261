"""An emulated SCPI source in a process of its own, on TCP and on a pty at once, each with its own buffers."""

from __future__ import annotations

import math
import os
import pty
import re
import selectors
import socket
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, Protocol

from daq.clock import SystemClock
from drivers.emulator_process import START_DEADLINE_S, EmulatedInstrument, start
from drivers.protocols.generator import DriveSettings
from drivers.protocols.instrument import ActuatorOutput
from drivers.protocols.speed_drive import MotorOutput
from drivers.rehearsal import Rehearsal, Rehearsed
from drivers.scpi.emulator import agilent_33220a, keysight_n6900
from drivers.scpi.emulator.agilent_33220a import Emulated33220A
from drivers.scpi.emulator.command_tree import CommandError
from drivers.scpi.emulator.keysight_n6900 import EmulatedN6900
from drivers.scpi.supply_settings import Trouble

INPUT_BUFFER = 65536  # bytes; beyond, -363 and all of it is dropped
_OFF = re.compile(r"(OUTP(UT)?(:STAT(E)?)? (OFF|0)|\*RST)", re.IGNORECASE)
_GARBLED = {code: code ^ 0x40 for code in range(0x20, 0x7F)}  # a bit of each character is wrong
_LOOK_S = 0.02  # how late a rehearsed fault or a watchdog may come
OUTPUT_BUFFER = 65536  # bytes; beyond, -430 (IEEE 488.2: deadlocked) and all of it is dropped


@dataclass(slots=True)
class _Port:
    """One way in: how to read and write its bytes, and what is under way."""

    handle: int
    receive: Callable[[int], bytes]
    send: Callable[[bytes], int]
    received: bytearray = field(default_factory=bytearray)
    pending: bytearray = field(default_factory=bytearray)
    hang_up: Callable[[], None] | None = None


class ScpiServer:
    """Listens on 127.0.0.1 and on a pty until `stop`; `stale_answer` lies in each port before anyone asks."""

    def __init__(
        self,
        instrument: Emulated33220A | EmulatedN6900,
        stale_answer: bytes = b"",
        rehearsed: tuple[Rehearsed, ...] = (),
    ) -> None:
        self._instrument, self._stale_answer = instrument, stale_answer
        self._endless_errors = any(fault.kind == "endless_errors" for fault in rehearsed)
        self._stays_on, self._spoilt = False, dict[str, float]()
        self._supply = instrument if isinstance(instrument, EmulatedN6900) else None  # which time trips too
        self._to_come, self._look_s = Rehearsal(rehearsed), _LOOK_S if rehearsed or self._supply else None
        self.used_s = math.inf  # monotonic s of the first output: faults count from there
        self._selector = selectors.DefaultSelector()
        self._listener: socket.socket | None = None
        self._pty: tuple[int, int] | None = None
        self._wake_read, self._wake_write = -1, -1  # a pipe ends `select` from another thread

    def open(self) -> tuple[str, str]:
        """Open both ports; return their VISA resource strings, TCP first."""
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ, None)
        self._wake_read, self._wake_write = os.pipe()
        self._selector.register(self._wake_read, selectors.EVENT_READ, None)
        # The slave stays open here: without it a read of the master fails once a client has gone.
        self._pty = master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        port = _Port(master, lambda count: os.read(master, count), lambda data: os.write(master, data))
        self._selector.register(master, selectors.EVENT_READ, port)
        self._answer(port, self._stale_answer)
        address = self._listener.getsockname()
        return f"TCPIP::127.0.0.1::{address[1]}::SOCKET", f"ASRL{os.ttyname(slave)}::INSTR"

    def serve(self) -> None:
        """Answer until `stop` is called."""
        while True:
            self._pass()
            for key, events in self._selector.select(self._look_s):
                if key.fileobj == self._wake_read:
                    return
                if key.data is None:
                    self._accept()
                    continue
                try:
                    if events & selectors.EVENT_WRITE:
                        self._flush(key.data)
                    if events & selectors.EVENT_READ:
                        self._take(key.data)
                except BlockingIOError:
                    continue
                except OSError:
                    self._drop(key.data)

    def _pass(self) -> None:
        """What comes by itself."""
        for fault in self._to_come.due(SystemClock().monotonic_s() - self.used_s):
            if fault.kind == "set_by_another":
                self._instrument.run(f"VOLT {fault.number('volts')}")
            elif fault.kind == "trips" and self._supply is not None:
                self._supply.trip(Trouble.OVER_TEMPERATURE)
            elif fault.kind == "stays_on":
                self._stays_on = True
            elif fault.kind in ("garbled", "unterminated"):
                self._spoilt[fault.kind] = fault.number("share")
        if self._supply is not None:
            self._supply.look()

    def stop(self) -> None:
        """End `serve`; may be called by any thread."""
        os.write(self._wake_write, b"x")

    def close(self) -> None:
        for key in list(self._selector.get_map().values()):
            if key.data is not None and key.data.hang_up is not None:
                key.data.hang_up()
        self._selector.close()
        if self._listener is not None:
            self._listener.close()
        for handle in (*(self._pty or ()), self._wake_read, self._wake_write):
            os.close(handle)

    def _accept(self) -> None:
        assert self._listener is not None  # noqa: S101 - serve follows open
        try:
            connection, _ = self._listener.accept()
        except OSError:  # it has hung up already
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # answers at once
        port = _Port(connection.fileno(), connection.recv, connection.send, hang_up=connection.close)
        self._selector.register(connection, selectors.EVENT_READ, port)
        with suppress(OSError):  # if it has hung up, its first read says so
            self._answer(port, self._stale_answer)

    def _take(self, port: _Port) -> None:
        data = port.receive(4096)
        if not data:
            self._drop(port)
            return
        port.received += data
        *lines, rest = port.received.split(b"\n")  # half a message waits for its end
        port.received = bytearray(rest)
        for line in lines:
            answer = self._run(line.decode("latin-1").strip("\r"))
            if answer is not None:
                end = b"" if self._spoils("unterminated") else b"\n"
                self._answer(port, answer.encode("ascii", "replace") + end)
        if len(port.received) > INPUT_BUFFER:
            port.received.clear()
            self._instrument.status.report(CommandError(-363))

    def _run(self, line: str) -> str | None:
        """What the instrument makes of a line, as far as nothing is wrong with it."""
        if self._stays_on and _OFF.fullmatch(line):
            return None
        if self._endless_errors and line == "SYST:ERR?":
            return f'-113,"{CommandError(-113)}"'
        answer = self._instrument.run(line)
        return answer.translate(_GARBLED) if answer is not None and self._spoils("garbled") else answer

    def _spoils(self, kind: str) -> bool:
        return self._to_come.lot.random() < self._spoilt.get(kind, 0.0)

    def _answer(self, port: _Port, data: bytes) -> None:
        if len(port.pending) + len(data) > OUTPUT_BUFFER:
            port.pending.clear()
            self._instrument.status.report(CommandError(-430))
            return
        port.pending += data
        self._flush(port)

    def _flush(self, port: _Port) -> None:
        try:
            while port.pending:
                del port.pending[: port.send(bytes(port.pending))]
        except BlockingIOError:
            pass
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if port.pending else 0)
        self._selector.modify(port.handle, events, port)  # writable is asked for only while something waits

    def _drop(self, port: _Port) -> None:
        if port.hang_up is not None:  # the pty outlives its clients
            self._selector.unregister(port.handle)
            port.hang_up()


@dataclass(frozen=True, slots=True)
class SourceSetup:
    """How an emulated source behaves: its *IDN? answer (None: its own), and what it starts with (faults).

    `pending_errors` are SCPI codes in its error queue, `stale_answer` bytes that lie unread in its ports.
    """

    identity: str | None = None
    pending_errors: tuple[int, ...] = ()
    stale_answer: bytes = b""
    rehearsed: tuple[Rehearsed, ...] = ()


def spoilt(faults: tuple[Rehearsed, ...]) -> SourceSetup:
    """A source to which these come, some of them from the start."""
    errors = [-113] * sum(int(each.number("count")) for each in faults if each.kind == "errors")
    kinds = {each.kind for each in faults}
    return SourceSetup(
        "Another Maker,Model 1,0,1.0" if "wrong_model" in kinds else None,
        tuple(errors),
        b"+1.5E+00\nhalf an ans" if "stale_answer" in kinds else b"",
        faults,
    )


class Told(Protocol):
    """The way to another process, or to several: a connection is one."""

    def send(self, output: Any, /) -> None:
        """Pass on what is put out; OSError where nobody is there any more."""


def start_function_generator(
    drive: Connection | None = None,
    setup: SourceSetup | None = None,
    name: str = "emulated signal generator",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated 33220A; its addresses are VISA resource strings, TCP first, then the pty.

    Every change of its output goes to `drive`. Raises `InstrumentAbsent` where it does not start in time.
    """
    return start(partial(_generator, drive, setup or SourceSetup()), name, deadline_s)


def start_dc_supply(
    outputs: Told | None = None,
    setup: SourceSetup | None = None,
    name: str = "emulated DC supply",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated N6954A; its addresses are as those of the generator.

    Every change of its output (`MotorOutput`) goes to `outputs`. Raises like that of the generator.
    """
    return start(partial(_supply, outputs, setup or SourceSetup()), name, deadline_s)


def _generator(drive: Connection | None, setup: SourceSetup) -> ScpiServer:
    def tell(output: DriveSettings) -> None:
        _pass_on(server, drive, output, output.on)

    identity = agilent_33220a.IDENTITY if setup.identity is None else setup.identity
    instrument = Emulated33220A(tell, SystemClock().monotonic_s, identity, setup.pending_errors)
    server = ScpiServer(instrument, setup.stale_answer, setup.rehearsed)
    return server


def _supply(outputs: Told | None, setup: SourceSetup) -> ScpiServer:
    def tell(output: MotorOutput) -> None:
        _pass_on(server, outputs, output, output.on)

    identity = keysight_n6900.IDENTITY if setup.identity is None else setup.identity
    instrument = EmulatedN6900(tell, SystemClock().monotonic_s, identity, setup.pending_errors)
    server = ScpiServer(instrument, setup.stale_answer, setup.rehearsed)
    return server


def _pass_on(server: ScpiServer, sink: Told | None, output: ActuatorOutput, on: bool) -> None:
    if on:
        server.used_s = min(server.used_s, output.started_s)
    if sink is not None:
        with suppress(OSError):  # the card is gone; the source goes on
            sink.send(output)
