"""A small process that brings the drive to rest when the run can no longer do so itself."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection

from daq.errors import RattleError
from daq.process import Child
from drivers.protocols.instrument import Actuator
from rig.session.signals import STOP_SIGNALS

SILENCE_S = 4.0
"""Longer than a card may take to answer (block and 1.5 s), so that a slow card is the run's own affair."""
_START_S = 30.0
_AGAIN_S = 1.0
_READY, _DONE, _TRIPPED = "ready", "done", "tripped"
_LET_GO = (
    "rattle: the run gave no sign of life for {silence:g} s and was ended, so that nothing is sent to the "
    "motor any more: its inverter's own watchdog (Pr.122) stops it. What was recorded: rattle recover"
)
_GONE = "rattle: the run is gone; the inverter's own watchdog (Pr.122) stops the motor"


class SupervisorTripped(RattleError, RuntimeError):
    """The run hung and the supervisor has switched the drive off."""


class Supervisor:
    """Brings the drive to rest when this process dies or `beat` stays away for 4 s.

    `spare` makes a second driver of the same actuator, which switches it off by a connection of its own; it
    must be picklable. Where it is None no second one can be opened: then the supervisor ends a run that
    hangs, so that nothing keeps the actuator's own watchdog quiet, which does the rest (docs/decisions/0008).
    """

    def __init__(self, spare: Callable[[], Actuator] | None) -> None:
        # Nothing but its pipe or SIGKILL ends it, and not that the run is gone: that is what it is there for.
        self._child = Child("supervisor", _supervise, spare, deaf_to=STOP_SIGNALS, grace_s=None)

    def launch(self) -> None:
        """Start the process, which takes seconds; `with` waits for it and `close` ends it."""
        self._child.start()

    def __enter__(self) -> Supervisor:
        try:
            ready = self._child.pipe.poll(_START_S) and self._child.pipe.recv() == _READY
        except (EOFError, OSError):
            ready = False
        if not ready:
            raise SupervisorTripped("the supervisor did not start; nothing moves without it")
        # A frozen supervisor must not hold up the acquisition with a full pipe.
        os.set_blocking(self._child.pipe.fileno(), False)
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process; may be called twice."""
        with suppress(OSError):
            self._child.pipe.send(_DONE)
        self._child.end(2.0)
        self._child.pipe.close()

    def beat(self, patience_s: float = SILENCE_S) -> None:
        """Say that samples come and that the sequence looks at them; the next may take `patience_s`.

        No later beat with less patience takes back what an earlier one asked for.
        """
        with suppress(OSError):
            self._child.pipe.send(patience_s)

    def check(self) -> None:
        """Raise SupervisorTripped if it has switched the drive off, or has died itself."""
        if not self._child.alive:
            raise SupervisorTripped("the supervisor is gone, tripped or dead; no run goes on without it")
        if self._child.pipe.poll():
            raise SupervisorTripped(
                f"the supervisor stopped the drive: the run gave no sign of life for {SILENCE_S:g} s"
            )


def _supervise(pipe: Connection, spare: Callable[[], Actuator] | None) -> None:
    run = os.getppid()
    os.setsid()  # what the terminal sends to the run must not end its safety net too
    if spare is not None:
        spare()  # so that all that its driver needs is loaded while everything is still well
    pipe.send(_READY)
    why = _await_silence(pipe)
    if why is None:
        return
    if spare is None:
        if why != _GONE and os.getppid() == run:  # one that hangs may poll on, which keeps the motor turning
            os.kill(run, signal.SIGKILL)
        with suppress(OSError):
            print(why, file=sys.stderr, flush=True)
        return
    while not switch_off(spare):  # nobody else is left to try again
        time.sleep(_AGAIN_S)
    with suppress(OSError):
        pipe.send(_TRIPPED)


def _await_silence(pipe: Connection) -> str | None:
    """Wait until the run dies or beats no more, and say which; None where it has ended as it should."""
    until_s: float | None = None
    try:
        while pipe.poll(None if until_s is None else max(until_s - time.monotonic(), 0.0)):
            message = pipe.recv()
            if message == _DONE:
                return None
            until_s = max(until_s or 0.0, time.monotonic() + message)
    except (EOFError, OSError):
        return None if until_s is None else _GONE
    return _LET_GO.format(silence=SILENCE_S)


def switch_off(spare: Callable[[], Actuator]) -> bool:
    """Switch the drive off by a new connection; returns whether the actuator took it, whatever it raised."""
    with suppress(Exception):
        actuator = spare()
        try:
            actuator.open()
            actuator.off()
        finally:
            actuator.close()
        return True
    return False
