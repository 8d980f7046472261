"""A person who does what is asked, not quite, and corrects it by what they are told is measured."""

from __future__ import annotations

import math
import socketserver
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Final, Protocol

from daq.clock import SystemClock
from drivers.emulator_process import START_DEADLINE_S, EmulatedInstrument, start
from drivers.manual.actuator import REST
from drivers.protocols.generator import DriveSettings
from drivers.protocols.instrument import ActuatorOutput
from drivers.protocols.speed_drive import MotorOutput

HAND_S: Final = 1.0
"""From rest to what is asked, and back."""
_FIRST: Final = 1.03
"""How far the first setting of a knob is beyond what was asked."""

Knobs = tuple[float, ...]


class Told(Protocol):
    """The way to the rig: a connection is one."""

    def send(self, output: ActuatorOutput, /) -> None:
        """Pass on what is put out; OSError where nobody is there any more."""


def turned(knobs: Knobs, before: MotorOutput | None, now_s: float) -> MotorOutput:
    """A shaft at `knobs[0]` rad/s, by what turns 1 rad/s per level."""
    level = 0.0 if before is None else before.at(now_s)
    return MotorOutput(True, level, knobs[0], max(level, knobs[0]) / HAND_S, now_s)


def shaken(knobs: Knobs, before: DriveSettings | None, now_s: float) -> DriveSettings:
    """A force of `knobs` (Hz, N peak) by what makes 1 N a volt; its phase goes on."""
    phase = 0.0
    if before is not None:
        phase = before.phase_rad + math.tau * before.frequency_hz * (now_s - before.started_s)
    frequency_hz, amplitude = knobs
    return DriveSettings(amplitude > 0.0, frequency_hz, amplitude, 0.0, now_s, phase % math.tau)


class EmulatedPerson:
    """Hears `set NUMBERS`, `shows NUMBERS` and `rest` on a port of this machine; several may speak.

    `sets` makes an output of the knobs, the one before and the time; every change goes to `sink`.
    """

    def __init__(self, sets: Callable[[Knobs, Any, float], Any], sink: Told | None) -> None:
        self._sets, self._sink = sets, sink
        self._wanted: Knobs = ()
        self._knobs: Knobs = ()
        self._output: Any = None
        self._turn = threading.Lock()
        self._server: socketserver.ThreadingTCPServer | None = None

    def open(self) -> Sequence[str]:
        """Begin to listen; where."""
        person = self

        class Ears(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                with suppress(OSError):
                    for line in self.rfile:
                        self.wfile.write(person.heed(line.decode("ascii", "replace")).encode() + b"\n")

        self._server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Ears)
        self._server.daemon_threads, self._server.block_on_close = True, False
        return (f"127.0.0.1:{self._server.server_address[1]}",)

    def heed(self, line: str) -> str:
        """Do what a line says; returns the answer."""
        order, *said = line.split() or [""]
        try:
            numbers = tuple(map(float, said))
        except ValueError:
            return "what?"
        with self._turn:
            if order == REST and not numbers:
                self._put_out((*self._knobs[:-1], 0.0) if self._knobs else ())
            elif order == "set" and numbers:
                self._wanted = numbers
                self._put_out(tuple(_FIRST * number for number in numbers))
            elif order == "shows" and len(numbers) == len(self._knobs):
                both = zip(self._knobs, self._wanted, numbers, strict=True)
                self._put_out(tuple(k * w / shown if shown > 0.0 else k for k, w, shown in both))
            else:
                return "what?"
        return "ok"

    def serve(self) -> None:
        if self._server is not None:
            self._server.serve_forever(0.05)

    def stop(self) -> None:
        if self._server is not None:
            self._server.shutdown()

    def close(self) -> None:
        if self._server is not None:
            self._server.server_close()

    def _put_out(self, knobs: Knobs) -> None:
        if not knobs:
            return
        self._knobs = knobs
        self._output = self._sets(knobs, self._output, SystemClock().monotonic_s())
        if self._sink is not None:
            with suppress(OSError):  # the card is gone; the person goes on
                self._sink.send(self._output)


def start_person(
    sets: Callable[[Knobs, Any, float], Any],
    sink: Told | None = None,
    name: str = "emulated person",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated person, who sets by `turned` or `shaken`; raises `InstrumentAbsent` as others do."""
    return start(partial(EmulatedPerson, sets, sink), name, deadline_s)
