"""The emulated encoder in a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from daq.clock import SystemClock
from drivers.canopen_cia406.emulator.setup import EncoderSetup
from drivers.emulator_process import START_DEADLINE_S, EmulatedInstrument, start
from drivers.protocols.encoder import Shaft

if TYPE_CHECKING:
    from drivers.canopen_cia406.emulator.encoder import EmulatedEncoder


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
    return start(partial(_encoder, shaft, setup or EncoderSetup()), name, deadline_s)


def _encoder(shaft: Callable[[], Shaft], setup: EncoderSetup) -> EmulatedEncoder:
    from drivers.canopen_cia406.emulator.encoder import EmulatedEncoder  # here, in the new process

    return EmulatedEncoder(shaft(), setup, SystemClock())
