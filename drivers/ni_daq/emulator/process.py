"""The emulated card in a process of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from daq.clock import SystemClock
from drivers.emulator_process import START_DEADLINE_S, EmulatedInstrument, start
from drivers.ni_daq.emulator.wiring import CardWiring, spoilt
from drivers.protocols.card import Plant
from drivers.protocols.instrument import ActuatorOutput

Output = TypeVar("Output", bound=ActuatorOutput)


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
    return start(partial(_Card, plant, wiring, drive, initial), name, deadline_s)


class _Card:
    """A card server with the thread that brings in the drive."""

    def __init__(
        self,
        plant: Callable[[], Plant[Output]],
        wiring: CardWiring,
        drive: Connection | None,
        initial: Output | None,
    ) -> None:
        # Here, in the new process: whoever starts it needs neither server nor converter.
        from drivers.ni_daq.emulator.acquisition import DriveInbox
        from drivers.ni_daq.emulator.servicer import CardServer, CardServicer
        from drivers.ni_daq.emulator.spoilt import SpoiltPlant

        self._inbox: DriveInbox[Any] = DriveInbox(initial)
        self._drive = drive
        shown: Plant[Any] = SpoiltPlant(plant(), wiring.faults, wiring.seed) if wiring.faults else plant()
        self._server = CardServer(CardServicer(shown, spoilt(wiring), self._inbox, SystemClock()))
        self._stopped = threading.Event()

    def open(self) -> tuple[str]:
        address, drive = self._server.open(), self._drive
        if drive is not None:

            def receive() -> None:
                with suppress(EOFError, OSError):  # the generator is gone; the drive stays as it was
                    while True:
                        self._inbox.put(drive.recv())

            threading.Thread(target=receive, daemon=True).start()
        return (address,)

    def serve(self) -> None:
        self._stopped.wait()

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._server.close()
