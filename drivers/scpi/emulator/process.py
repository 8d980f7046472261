"""The emulated generator in a process of its own."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection

from daq.clock import SystemClock
from drivers.emulator_process import START_DEADLINE_S, EmulatedInstrument, start
from drivers.protocols.generator import DriveSettings
from drivers.scpi.emulator.agilent_33220a import IDENTITY, Emulated33220A
from drivers.scpi.emulator.server import ScpiServer


@dataclass(frozen=True, slots=True)
class GeneratorSetup:
    """How the emulated generator behaves: its *IDN? answer, and what it starts with (faults to rehearse).

    `pending_errors` are SCPI codes in its error queue, `stale_answer` bytes that lie unread in its ports.
    """

    identity: str = IDENTITY
    pending_errors: tuple[int, ...] = ()
    stale_answer: bytes = b""


def start_function_generator(
    drive: Connection | None = None,
    setup: GeneratorSetup | None = None,
    name: str = "emulated signal generator",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated 33220A; its addresses are VISA resource strings, TCP first, then the pty.

    Every change of its output goes to `drive`. Raises `InstrumentAbsent` where it does not start in time.
    """
    return start(partial(_server, drive, setup or GeneratorSetup()), name, deadline_s)


def _server(drive: Connection | None, setup: GeneratorSetup) -> ScpiServer:
    def tell(settings: DriveSettings) -> None:
        if drive is not None:
            with suppress(OSError):  # the card is gone; the generator goes on
                drive.send(settings)

    instrument = Emulated33220A(tell, SystemClock().monotonic_s, setup.identity, setup.pending_errors)
    return ScpiServer(instrument, setup.stale_answer)
