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
    rehearsal: Connection | None = None,
) -> EmulatedInstrument:
    """Start an emulated card on a gRPC device server; its address is `host:port`.

    `plant` is called in the new process, so it must be picklable. The plant hears of `initial` when sampling
    starts, and of what comes through `drive`. `rehearsal` brings what is on the digital inputs, as
    `CardWiring.lines` says it. Raises `ConfigurationError` for a wiring that no card has,
    `InstrumentAbsent` where it does not start in time.
    """
    wiring.devices()  # raises here and not in the new process, where nobody would see it
    return start(partial(_Card, plant, wiring, drive, initial, rehearsal), name, deadline_s)


class _Card:
    """A card server with the thread that brings in the drive."""

    def __init__(
        self,
        plant: Callable[[], Plant[Output]],
        wiring: CardWiring,
        drive: Connection | None,
        initial: Output | None,
        rehearsal: Connection | None,
    ) -> None:
        # Here, in the new process: whoever starts it needs neither server nor converter.
        from drivers.ni_daq.emulator.acquisition import DriveInbox
        from drivers.ni_daq.emulator.servicer import CardServer, CardServicer
        from drivers.ni_daq.emulator.spoilt import SpoiltPlant

        self._inbox: DriveInbox[Any] = DriveInbox(initial)

        def press() -> None:
            servicer.put_lines({line: not healthy for line, healthy in wiring.lines.items()})

        faults = wiring.faults
        shown: Plant[Any] = SpoiltPlant(plant(), faults, wiring.seed, press) if faults else plant()
        servicer = CardServicer(shown, spoilt(wiring), self._inbox, SystemClock())
        self._server = CardServer(servicer)
        self._heard = ((drive, self._inbox.put), (rehearsal, servicer.put_lines))
        self._stopped = threading.Event()

    def open(self) -> tuple[str]:
        def receive(heard: Connection, put: Callable[[Any], None]) -> None:
            with suppress(EOFError, OSError):  # who tells is gone; all stays as it was
                while True:
                    put(heard.recv())

        for heard, put in self._heard:
            if heard is not None:
                threading.Thread(target=receive, args=(heard, put), daemon=True).start()
        return (self._server.open(),)

    def serve(self) -> None:
        self._stopped.wait()

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._server.close()
