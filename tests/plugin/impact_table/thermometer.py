"""A thermometer that is asked over TCP: it measures beside the card, on the bench of whatever rig."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from daq.channel import Channel
from daq.errors import DeviceLost, InstrumentAbsent, InstrumentSilent
from daq.quantity import Key, Quantity, Text
from drivers.emulator_process import EmulatedInstrument, start
from rig.instruments import Instrument

ANSWER_S = 0.5
SHOWN_K = (293.5, 294.0, 294.5)
"""What the emulated one shows in turn."""


@dataclass(frozen=True, slots=True)
class ThermometerSettings:
    """The table [thermometer]: where it listens, and how often it is asked."""

    driver: Annotated[Literal["tcp_thermometer"], Key()] = "tcp_thermometer"
    address: Annotated[str, Text("host:port on this machine", r"127\.0\.0\.1:\d{1,5}")] = ""
    emulated: Annotated[bool, Key()] = False
    period: Annotated[float, Quantity("s", 0.1, 3600)] = 1.0

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        return {"address": address}

    def at(self, address: str) -> ThermometerSettings:
        return replace(self, address=address)


class Thermometer:
    """Sends ?, reads kelvin and a newline."""

    name = "thermometer"
    channels = (Channel("hall.temperature", "K", "temperature", "hall", "PT100"),)

    def __init__(self, settings: ThermometerSettings) -> None:
        self.address, self.period_s, self.identity = settings.address, settings.period, ""
        self._wire: socket.socket | None = None

    def open(self) -> None:
        host, _, port = self.address.rpartition(":")
        try:
            self._wire = socket.create_connection((host, int(port)), ANSWER_S)
        except OSError as error:
            raise InstrumentAbsent(self.name, self.address, str(error), "its plug") from error
        self.identity = "PT100 of the hall"

    def close(self) -> None:
        if self._wire is not None:
            self._wire.close()

    def read(self) -> tuple[float]:
        if self._wire is None:
            raise DeviceLost(self.name, self.address, "it is not open")
        try:
            self._wire.sendall(b"?")
            return (float(self._wire.recv(16)),)
        except TimeoutError as error:
            raise InstrumentSilent(self.name, self.address, "no answer", "its plug") from error
        except (OSError, ValueError) as error:
            raise DeviceLost(self.name, self.address, str(error)) from error


class EmulatedThermometer:
    """Answers on a port of its own."""

    def open(self) -> tuple[str]:
        self._listener, self._ends = socket.create_server(("127.0.0.1", 0)), False
        return (f"127.0.0.1:{self._listener.getsockname()[1]}",)

    def serve(self) -> None:
        while not self._ends:
            wire, _ = self._listener.accept()
            with wire, suppress(OSError):
                asked = 0
                while wire.recv(1):
                    wire.sendall(f"{SHOWN_K[asked % len(SHOWN_K)]}\n".encode())
                    asked += 1

    def stop(self) -> None:
        self._ends = True
        socket.create_connection(self._listener.getsockname()).close()

    def close(self) -> None:
        self._listener.close()


def emulator(bench: Any, rig: Any, seed: int, heard: Any) -> EmulatedInstrument:
    return start(EmulatedThermometer, "emulated thermometer")


_HERE = "impact_table.thermometer"
INSTRUMENT = Instrument(
    "thermometer",
    f"{_HERE}:ThermometerSettings",
    {"tcp_thermometer": f"{_HERE}:Thermometer"},
    emulator=f"{_HERE}:emulator",
    logs=True,
)
