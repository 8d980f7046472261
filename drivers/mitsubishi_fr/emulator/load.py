"""What the emulated drive turns, where no plant is handed in or it lives in another process."""

from __future__ import annotations

from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Protocol

from drivers.protocols.speed_drive import InverterOutput

NO_LOAD_A = 0.6


class OutputSink(Protocol):
    """The way to another process, or to several: a connection is one."""

    def send(self, output: InverterOutput, /) -> None:
        """Pass on what is put out; OSError where nobody is there any more."""
        ...


class FreeMotor:
    """A `MotorLoad` that turns nothing: its no-load current flows while anything is put out."""

    def __init__(self) -> None:
        self._on = False

    def drive(self, output: InverterOutput) -> None:
        """Take what is put out."""
        self._on = output.on and (output.frequency_hz > 0.0 or output.target_hz > 0.0)

    def current_a(self) -> float:
        """Return the current in A."""
        return NO_LOAD_A if self._on else 0.0


class RemoteLoad:
    """A `MotorLoad` in another process: outputs go to it, the last current (A, a float) that it sent counts.

    Without `currents` the current is that of a free motor.
    """

    def __init__(self, outputs: OutputSink | None, currents: Connection | None) -> None:
        self._outputs, self._currents = outputs, currents
        self._free = FreeMotor()
        self._current_a: float | None = None

    def drive(self, output: InverterOutput) -> None:
        """Pass on what is put out."""
        self._free.drive(output)
        if self._outputs is not None:
            with suppress(OSError):  # the plant is gone; the drive goes on
                self._outputs.send(output)

    def current_a(self) -> float:
        """Return the current in A."""
        with suppress(EOFError, OSError):
            while self._currents is not None and self._currents.poll():
                self._current_a = float(self._currents.recv())
        return self._free.current_a() if self._current_a is None else self._current_a
