"""A small process that switches the drive off when the run can no longer do so itself."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType

from daq.errors import InstrumentError, RattleError
from drivers.protocols import Actuator
from rig.session.signals import STOP_SIGNALS

SILENCE_S = 4.0
"""Longer than a card may take to answer (block and 1.5 s), so that a slow card is the run's own affair."""
_START_S = 30.0
_AGAIN_S = 1.0
_BEAT, _DONE = b"beat", b"done"


class SupervisorTripped(RattleError, RuntimeError):
    """The run hung and the supervisor has switched the drive off."""


class Supervisor:
    """Switches the drive off when this process dies or `beat` stays away for 4 s, by a connection of its own.

    `spare` makes a second driver of the same actuator; it must be picklable.
    """

    def __init__(self, spare: Callable[[], Actuator]) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, self._far_end = context.Pipe()
        self._process = context.Process(
            target=_supervise, args=(self._far_end, self._pipe, spare), name="supervisor", daemon=True
        )

    def launch(self) -> None:
        """Start the process, which takes seconds; `with` waits for it and `close` ends it."""
        # The child inherits the blocked signals for good: nothing but its pipe or SIGKILL ends it.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            self._far_end.close()

    def __enter__(self) -> Supervisor:
        try:
            ready = self._pipe.poll(_START_S) and self._pipe.recv_bytes()
        except (EOFError, OSError):
            ready = False
        if not ready:
            raise SupervisorTripped("the supervisor did not start; nothing moves without it")
        # A frozen supervisor must not hold up the acquisition with a full pipe.
        os.set_blocking(self._pipe.fileno(), False)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process; may be called twice."""
        with suppress(OSError):
            self._pipe.send_bytes(_DONE)
        self._process.join(2.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()

    def beat(self) -> None:
        """Say that samples come and that the sequence looks at them."""
        with suppress(OSError):
            self._pipe.send_bytes(_BEAT)

    def check(self) -> None:
        """Raise SupervisorTripped if it has switched the drive off, or has died itself."""
        if not self._process.is_alive():
            raise SupervisorTripped("the supervisor is gone, tripped or dead; no run goes on without it")
        if self._pipe.poll():
            raise SupervisorTripped(
                f"the supervisor stopped the drive: the run gave no sign of life for {SILENCE_S:g} s"
            )


def _supervise(pipe: Connection, parents_end: Connection, spare: Callable[[], Actuator]) -> None:
    os.setsid()  # what the terminal sends to the run must not end its safety net too
    parents_end.close()  # inherited; while it is open here, the parent's death would not show
    pipe.send_bytes(b"ready")
    armed = False
    try:
        while pipe.poll(SILENCE_S if armed else None):
            if pipe.recv_bytes() == _DONE:
                return
            armed = True
    except (EOFError, OSError):
        if not armed:
            return
    while not switch_off(spare):
        time.sleep(_AGAIN_S)
    with suppress(OSError):
        pipe.send_bytes(b"tripped")


def switch_off(spare: Callable[[], Actuator]) -> bool:
    """Switch the drive off by a new connection; returns whether the actuator took it."""
    actuator = spare()
    try:
        actuator.open()
        actuator.off()
    except InstrumentError:
        return False
    finally:
        actuator.close()
    return True
