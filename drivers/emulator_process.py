"""Emulated instruments, each in a process of its own.

A child ignores Ctrl-C, so that the parent can bring the rig to its safe state first, and ends by itself when
the parent is gone: it holds one end of a pipe whose other end only the parent has.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, TypeVar

from daq import SystemClock
from daq.errors import InstrumentAbsent
from drivers.canopen_cia406.emulator.encoder import EmulatedEncoder
from drivers.canopen_cia406.emulator.setup import EncoderSetup
from drivers.mitsubishi_fr.emulator import InverterSetup, LineFaults
from drivers.mitsubishi_fr.emulator.drive import PARAMETERS, EmulatedDrive
from drivers.mitsubishi_fr.emulator.load import OutputSink, RemoteLoad
from drivers.mitsubishi_fr.emulator.server import InverterServer
from drivers.ni_daq.emulator.acquisition import DriveInbox
from drivers.ni_daq.emulator.server import CardServer
from drivers.ni_daq.emulator.servicer import CardServicer
from drivers.ni_daq.emulator.wiring import CardWiring
from drivers.protocols import ActuatorOutput, DriveSettings, Plant, Shaft
from drivers.scpi.emulated_33220a import IDENTITY, Emulated33220A
from drivers.scpi.emulator import ScpiServer

START_DEADLINE_S = 60.0  # a plant may have to be compiled first
STOP_DEADLINE_S = 5.0
STATION_PARAMETER = 117
Output = TypeVar("Output", bound=ActuatorOutput)


class _Server(Protocol):
    """What runs in a child."""

    def open(self) -> Sequence[str]: ...

    def serve(self) -> None: ...

    def stop(self) -> None: ...

    def close(self) -> None: ...


@dataclass(slots=True)
class EmulatedInstrument:
    """An emulator that runs. `address` is where its driver finds it, `addresses` is every way to it."""

    name: str
    addresses: tuple[str, ...]
    process: BaseProcess
    _lifeline: Connection = field(repr=False)

    @property
    def address(self) -> str:
        """The first of its addresses."""
        return self.addresses[0]

    @property
    def pid(self) -> int:
        """Its process."""
        assert self.process.pid is not None  # noqa: S101 - it was started
        return self.process.pid

    def close(self) -> None:
        """End the process: politely, then after 5 s for good. May be called twice."""
        self._lifeline.close()
        _end(self.process)

    def __enter__(self) -> EmulatedInstrument:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


@dataclass(slots=True)
class DriveLink:
    """Carries the output of an emulated generator to the plant of an emulated card.

    To be closed here once both have started.
    """

    receiver: Connection
    sender: Connection

    @classmethod
    def new(cls) -> DriveLink:
        """Make a link that nobody uses yet."""
        receiver, sender = multiprocessing.get_context("spawn").Pipe(duplex=False)
        return cls(receiver, sender)

    def close(self) -> None:
        """Drop the parent's ends."""
        self.receiver.close()
        self.sender.close()

    def __enter__(self) -> DriveLink:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


@dataclass(frozen=True, slots=True)
class GeneratorSetup:
    """How the emulated generator behaves: its *IDN? answer, and what it starts with (faults to rehearse).

    `pending_errors` are SCPI codes in its error queue, `stale_answer` bytes that lie unread in its ports.
    """

    identity: str = IDENTITY
    pending_errors: tuple[int, ...] = ()
    stale_answer: bytes = b""


@dataclass(frozen=True, slots=True)
class InverterWiring:
    """What an emulated inverter is joined to, by connections to other processes.

    Every change of its output (`InverterOutput`) goes to `outputs`; `currents` brings the motor current in A
    as floats; `rehearsal` brings what is to go wrong (`LineFaults`, `DriveFaults`, `Trip`).
    """

    outputs: OutputSink | None = None
    currents: Connection | None = None
    rehearsal: Connection | None = None


def start_function_generator(
    drive: Connection | None = None,
    setup: GeneratorSetup | None = None,
    name: str = "emulated signal generator",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated 33220A; its addresses are VISA resource strings, TCP first, then the pty.

    Every change of its output goes to `drive`. Raises `InstrumentAbsent` where it does not start in time.
    """
    return _start(name, _generator_server, (drive, setup or GeneratorSetup()), deadline_s)


def start_daq_card(
    plant: Callable[[], Plant[Output]],
    wiring: CardWiring,
    drive: Connection | None = None,
    initial: Output | None = None,
    name: str = "emulated DAQ card",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated card on a gRPC device server; its address is `host:port`.

    `plant` is called in the new process, so it must be picklable. The plant hears of `initial` when sampling
    starts, and of what comes through `drive`. Raises `ConfigurationError` for a wiring that no card has,
    `InstrumentAbsent` where it does not start in time.
    """
    wiring.devices()
    return _start(name, _card_server, (plant, wiring, drive, initial), deadline_s)


def start_inverter(
    wiring: InverterWiring | None = None,
    setup: InverterSetup | None = None,
    line: LineFaults | None = None,
    name: str = "emulated inverter",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated FR-D700; its addresses are ports for pyserial, TCP first, then the pty.

    On the pty only parity N can be chosen. Raises `InstrumentAbsent` where it does not start in time.
    """
    arguments = (wiring or InverterWiring(), setup or InverterSetup(), line or LineFaults())
    return _start(name, _inverter_server, arguments, deadline_s)


def start_encoder(
    shaft: Callable[[], Shaft],
    setup: EncoderSetup | None = None,
    name: str = "emulated encoder",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated CANopen encoder; its address is the `host:port` of its socketcand server.

    `shaft` is called in the new process, so it must be picklable, and returns the angle over time. Raises
    `InstrumentAbsent` where it does not start in time.
    """
    return _start(name, _encoder_server, (shaft, setup or EncoderSetup()), deadline_s)


def _start(
    name: str, make: Callable[..., _Server], arguments: tuple[object, ...], deadline_s: float
) -> EmulatedInstrument:
    context = multiprocessing.get_context("spawn")
    child_lifeline, lifeline = context.Pipe(duplex=False)
    report, child_report = context.Pipe(duplex=False)
    process = context.Process(
        target=_child, name=name, args=(child_lifeline, child_report, make, arguments), daemon=True
    )
    # The child inherits the blocked SIGINT, so that no Ctrl-C can reach it before it ignores it.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        child_lifeline.close()
        child_report.close()
    try:
        addresses = _await_addresses(name, report, deadline_s)
    except BaseException:
        lifeline.close()
        _end(process)
        raise
    finally:
        report.close()
    return EmulatedInstrument(name, addresses, process, lifeline)


def _await_addresses(name: str, report: Connection, deadline_s: float) -> tuple[str, ...]:
    why = f"it did not start within {deadline_s:g} s"
    try:
        if report.poll(deadline_s):
            addresses, why = report.recv()
            if addresses:
                return tuple(addresses)
    except EOFError:
        why = "its process ended at once"
    raise InstrumentAbsent(name, "its own process", why, "the message of its process on standard error")


def _end(process: BaseProcess) -> None:
    process.join(STOP_DEADLINE_S)
    for end in (process.terminate, process.kill):
        if process.is_alive():
            end()
            process.join(1.0)


def _child(
    lifeline: Connection, report: Connection, make: Callable[..., _Server], arguments: tuple[object, ...]
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    running: list[_Server] = []
    threading.Thread(target=_end_with_parent, args=(lifeline, running), daemon=True).start()
    try:
        server = make(*arguments)
        addresses = server.open()
    except Exception as error:  # top of a process: the parent is to hear of it
        traceback.print_exc(file=sys.stderr)
        report.send(((), f"{type(error).__name__}: {error}"))
        return
    running.append(server)
    report.send((addresses, ""))
    report.close()
    server.serve()
    server.close()


def _end_with_parent(lifeline: Connection, running: list[_Server]) -> None:
    with suppress(EOFError, OSError):
        lifeline.recv_bytes()
    for server in running:
        server.stop()
    # Whatever hangs, a plant or a client, must not keep the process alive.
    grace_s = STOP_DEADLINE_S / 2.0 if running else 0.0
    threading.Timer(grace_s, os._exit, args=(1,)).start()


def _generator_server(drive: Connection | None, setup: GeneratorSetup) -> _Server:
    def tell(settings: DriveSettings) -> None:
        if drive is not None:
            with suppress(OSError):  # the card is gone; the generator goes on
                drive.send(settings)

    instrument = Emulated33220A(tell, SystemClock().monotonic_s, setup.identity, setup.pending_errors)
    return ScpiServer(instrument, setup.stale_answer)


def _inverter_server(wiring: InverterWiring, setup: InverterSetup, line: LineFaults) -> _Server:
    load = RemoteLoad(wiring.outputs, wiring.currents)
    drive = EmulatedDrive(setup, load, SystemClock().monotonic_s)
    station = {**PARAMETERS, **setup.parameters}[STATION_PARAMETER]
    return InverterServer(drive, station, line, wiring.rehearsal)


def _encoder_server(shaft: Callable[[], Shaft], setup: EncoderSetup) -> _Server:
    return EmulatedEncoder(shaft(), setup, SystemClock())


class _CardProcess:
    """A card server with the thread that brings in the drive."""

    def __init__(self, server: CardServer, inbox: DriveInbox[Any], drive: Connection | None) -> None:
        self._server, self._inbox, self._drive = server, inbox, drive
        self._stopped = threading.Event()

    def open(self) -> Sequence[str]:
        address = self._server.open()
        if self._drive is not None:
            threading.Thread(target=self._receive, args=(self._drive,), daemon=True).start()
        return (address,)

    def serve(self) -> None:
        self._stopped.wait()

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._server.close()

    def _receive(self, drive: Connection) -> None:
        with suppress(EOFError, OSError):  # the generator is gone; the drive stays as it was
            while True:
                self._inbox.put(drive.recv())


def _card_server(
    plant: Callable[[], Plant[Output]],
    wiring: CardWiring,
    drive: Connection | None,
    initial: Output | None,
) -> _Server:
    inbox = DriveInbox(initial)
    servicer = CardServicer(plant(), wiring, inbox, SystemClock())
    return _CardProcess(CardServer(servicer), inbox, drive)
