"""Instruments in processes of the test's own, whose drive it can follow and which it may freeze or kill."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from types import MappingProxyType

from drivers.emulator_process import DriveLink, EmulatedInstrument
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.emulator.wiring import CardWiring, Wire
from drivers.protocols.card import Plant
from drivers.protocols.generator import DriveSettings
from drivers.scpi.emulator.process import start_function_generator
from rig.files.bench import embedded_bench
from tests.drivers.plants import SinePlant
from tests.end_to_end.command import await_true
from tests.end_to_end.files import forget_stop


class DriveSpy:
    """Hears every change of a generator's output and passes it on to a card."""

    def __init__(self, receiver: Connection, onward: Connection | None) -> None:
        self.heard: list[DriveSettings] = []
        self.heard_ns: list[int] = []
        self._receiver, self._onward = receiver, onward
        self._thread = threading.Thread(target=self._listen, name="drive spy", daemon=True)
        self._thread.start()

    @property
    def on(self) -> bool:
        return bool(self.heard) and self.heard[-1].on

    @property
    def moved(self) -> bool:
        """Whether the shaker ever got a voltage."""
        return any(settings.on for settings in self.heard)

    def await_on(self) -> None:
        await_true("drive on", lambda: self.on, 60.0)

    def await_off(self) -> None:
        await_true("drive off", lambda: self.moved and not self.on, 10.0)

    def await_ramp_down(self) -> None:
        """Wait until the amplitude has begun to fall."""
        await_true("ramp down", lambda: self._falling() and self.on, 60.0)

    def _falling(self) -> bool:
        volts = [settings.amplitude_v for settings in self.heard if settings.on]
        return bool(volts) and 0.1 < volts[-1] < max(volts) and max(volts) in volts[:-1]

    def _listen(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                settings = self._receiver.recv()
                self.heard_ns.append(time.time_ns())
                self.heard.append(settings)
                if self._onward is not None:
                    self._onward.send(settings)

    def join(self) -> None:
        self._thread.join()


@contextmanager
def spied_generator(onward: Connection | None = None) -> Iterator[tuple[EmulatedInstrument, DriveSpy]]:
    """A generator and what it puts out."""
    with DriveLink.new() as link:
        generator = start_function_generator(link.sender)
        link.sender.close()
        spy = DriveSpy(link.receiver, onward)
        try:
            yield generator, spy
        finally:
            generator.close()
            forget_stop(generator.address)
            spy.join()


@contextmanager
def light_card(
    plant: Callable[[], Plant[DriveSettings]] = SinePlant,
    shown: Mapping[str, str] = MappingProxyType({}),
    lines: Mapping[str, bool] = MappingProxyType({}),
    rehearsal: Connection | None = None,
) -> Iterator[tuple[EmulatedInstrument, Connection]]:
    """A card whose force channels all show the drive, but for those of `shown`, and where to send the drive.

    `shown` has the plant's channel by the bench's. What `rehearsal` brings is on its digital inputs then,
    instead of `lines`.
    """
    wires = {
        channel.physical: Wire(
            shown.get(channel.name, "acceleration" if channel.unit == "m/s2" else "force"),
            channel.volts_per_unit,
        )
        for channel in embedded_bench().daq_card.channels
    }
    wiring = CardWiring(wires, lines=dict(lines))
    with (
        DriveLink.new() as link,
        start_daq_card(plant, wiring, link.receiver, rehearsal=rehearsal) as card,
    ):
        yield card, link.sender
