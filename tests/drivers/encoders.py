"""Emulated encoders in this process, and their shafts."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from typing import Any

from daq.clock import SystemClock
from drivers.canopen_cia406.emulator.encoder import EmulatedEncoder
from drivers.canopen_cia406.emulator.process import EncoderSetup
from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.canopen_cia406.settings import EncoderIdentity, EncoderSettings
from drivers.protocols.encoder import Shaft

PATIENCE_S = 5.0  # a busy machine may take this long to answer; nothing here depends on it
CALM_MS = (
    300  # the slowest heartbeat that the driver takes: three of them outlast most stalls of a busy machine
)


def turning(rev_per_s: float) -> Shaft:
    return lambda time_s: math.tau * rev_per_s * time_s


def slow_shaft() -> Shaft:
    return turning(1.7)


def socketcand(address: str, **settings: Any) -> EncoderSettings:
    host, port = address.split(":")
    settings.setdefault("timeout_s", PATIENCE_S)
    settings.setdefault("node", 7)
    known = [field.name for field in fields(EncoderIdentity)]
    settings["identity"] = EncoderIdentity(**{key: settings.pop(key) for key in known if key in settings})
    return EncoderSettings(
        interface="socketcand", options={"host": host, "port": int(port), "channel": "can0"}, **settings
    )


@contextmanager
def emulated(setup: EncoderSetup, shaft: Shaft | None = None) -> Iterator[str]:
    """Run an emulator and yield where it listens; its heartbeat is a calm one where `setup` has none."""
    setup = replace(setup, heartbeat_ms=setup.heartbeat_ms or CALM_MS)
    emulator = EmulatedEncoder(shaft or slow_shaft(), setup, SystemClock())
    address = emulator.open()[0]
    serving = threading.Thread(target=emulator.serve)
    serving.start()
    try:
        yield address
    finally:
        emulator.stop()
        serving.join()
        emulator.close()


@contextmanager
def opened(settings: EncoderSettings) -> Iterator[CanopenEncoder]:
    encoder = CanopenEncoder(settings)
    encoder.open()
    try:
        yield encoder
    finally:
        encoder.close()
