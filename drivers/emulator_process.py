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
from typing import Protocol

from daq.errors import InstrumentAbsent

START_DEADLINE_S = 60.0  # a plant may have to be compiled first
STOP_DEADLINE_S = 5.0


class Emulator(Protocol):
    """An emulated instrument of any kind, as its process runs it."""

    def open(self) -> Sequence[str]:
        """Begin to listen; return the ways to it, the usual one first."""
        ...

    def serve(self) -> None:
        """Answer until `stop`."""
        ...

    def stop(self) -> None:
        """End `serve`; called by another thread."""
        ...

    def close(self) -> None:
        """Leave the ports."""
        ...


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
    """Carries what one emulated instrument puts out to the plant of another.

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
class Fork:
    """Passes what one emulated instrument puts out on to several."""

    sinks: tuple[Connection, ...]

    def send(self, output: object, /) -> None:
        """Send it to all."""
        for sink in self.sinks:
            with suppress(OSError):  # one that is gone must not keep the others from hearing
                sink.send(output)


def start(
    make: Callable[[], Emulator], name: str, deadline_s: float = START_DEADLINE_S
) -> EmulatedInstrument:
    """Start the emulator that `make` returns; `name` is what messages call it.

    `make` is called in the new process, so it must be picklable, with all that is bound to it. Raises
    `InstrumentAbsent` where the emulator does not listen in time.
    """
    context = multiprocessing.get_context("spawn")
    child_lifeline, lifeline = context.Pipe(duplex=False)
    report, child_report = context.Pipe(duplex=False)
    process = context.Process(
        target=_child, name=name, args=(child_lifeline, child_report, make), daemon=True
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


def _child(lifeline: Connection, report: Connection, make: Callable[[], Emulator]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    running: list[Emulator] = []
    threading.Thread(target=_end_with_parent, args=(lifeline, running), daemon=True).start()
    try:
        emulator = make()
        addresses = emulator.open()
    except Exception as error:  # top of a process: the parent is to hear of it
        traceback.print_exc(file=sys.stderr)
        report.send(((), f"{type(error).__name__}: {error}"))
        return
    running.append(emulator)
    report.send((addresses, ""))
    report.close()
    emulator.serve()
    emulator.close()


def _end_with_parent(lifeline: Connection, running: list[Emulator]) -> None:
    with suppress(EOFError, OSError):
        lifeline.recv_bytes()
    for emulator in running:
        emulator.stop()
    # Whatever hangs, a plant or a client, must not keep the process alive.
    grace_s = STOP_DEADLINE_S / 2.0 if running else 0.0
    threading.Timer(grace_s, os._exit, args=(1,)).start()
