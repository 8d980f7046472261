"""Emulated instruments, each in a process of its own.

They do not hear Ctrl-C, so that the parent can bring the rig to its safe state first, and leave in good order
when it closes their pipe, or is gone.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Protocol

from daq.errors import InstrumentAbsent
from daq.process import Child

START_DEADLINE_S = 60.0  # a plant may have to be compiled first
STOP_DEADLINE_S = 5.0  # a child of its own accord takes half of that, below
_SWITCH_S = 0.0005
"""Between threads of an emulator. An instrument answers while its plant is computed; Python's own 5 ms, some
times for each answer, came to half a second on a busy machine."""


class Emulator(Protocol):
    """An emulated instrument of any kind, as its process runs it."""

    def open(self) -> Sequence[str]:
        """Begin to listen; return the ways to it, the usual one first."""

    def serve(self) -> None:
        """Answer until `stop`."""

    def stop(self) -> None:
        """End `serve`; called by another thread."""

    def close(self) -> None:
        """Leave the ports."""


@dataclass(slots=True)
class EmulatedInstrument:
    """An emulator that runs. `address` is where its driver finds it, `addresses` is every way to it."""

    name: str
    addresses: Sequence[str]
    child: Child = field(repr=False)

    @property
    def address(self) -> str:
        """The first of its addresses."""
        return self.addresses[0]

    @property
    def pid(self) -> int:
        """Its process."""
        assert self.child.pid is not None  # noqa: S101 - it was started
        return self.child.pid

    def close(self) -> None:
        """End the process: politely, then after 5 s for good. May be called twice."""
        self.child.pipe.close()
        self.child.end(STOP_DEADLINE_S, terminate_s=1.0)

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
        receiver, sender = multiprocessing.get_context("spawn").Pipe(duplex=False)  # children are spawned
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
    child = Child(name, _serve, make, grace_s=STOP_DEADLINE_S)
    child.start()
    started = EmulatedInstrument(name, (), child)
    why = f"it did not start within {deadline_s:g} s; on a machine that is busy call again"
    try:
        if child.pipe.poll(deadline_s):
            started.addresses, why = child.pipe.recv()
    except EOFError:
        why = "its process ended at once"
    except BaseException:
        started.close()
        raise
    if started.addresses:
        return started
    started.close()
    raise InstrumentAbsent(name, "its own process", why, "the message of its process on standard error")


def _serve(pipe: Connection, make: Callable[[], Emulator]) -> None:
    running: list[Emulator] = []

    def end_with_pipe() -> None:
        with suppress(EOFError, OSError):
            pipe.recv_bytes()
        for emulator in running:
            emulator.stop()
        # Whatever hangs, a plant or a client, must not keep the process alive.
        grace_s = STOP_DEADLINE_S / 2.0 if running else 0.0
        threading.Timer(grace_s, os._exit, args=(1,)).start()  # not sys.exit: that would wait for threads

    threading.Thread(target=end_with_pipe, daemon=True).start()  # the pipe's end is all that is heard
    sys.setswitchinterval(_SWITCH_S)
    try:
        emulator = make()
        addresses = emulator.open()
    except Exception as error:  # top of a process: the parent is to hear of it
        traceback.print_exc(file=sys.stderr)
        pipe.send(((), f"{type(error).__name__}: {error}"))
        return
    running.append(emulator)
    pipe.send((addresses, ""))
    emulator.serve()
    emulator.close()
