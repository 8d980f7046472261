"""Instruments and helpers inside the test's own process, for what no wire is needed."""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from daq.block import Flag, SampleBlock
from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import InstrumentSilent
from daq.log.reader import Origin
from daq.log.records import Event, Gap, Impact
from drivers.protocols.card import CardReading
from rig.session.progress import Screen
from rig.stream import Block, Record

RATE = 51_200.0
FAKE = f"fake of {os.getpid()}"
"""Nobody else's instrument, where tests run side by side."""


def silent_screen() -> Screen:
    """A screen whose text `console.export_text()` gives."""
    return Screen(Console(file=io.StringIO(), record=True, width=200))


class RecordingGenerator:
    """Writes down what it is told; fails with silence at one method."""

    def __init__(self, fails_at: str = "") -> None:
        self.name, self.address, self.identity = "signal generator", FAKE, "a fake"
        self.told: list[tuple[object, ...]] = []
        self._fails_at = fails_at

    def amplitudes(self) -> list[float]:
        return [float(str(each[1])) for each in self.told if each[0] == "set_amplitude"]

    def sine(self, seconds: NDArray[np.float64]) -> NDArray[np.float64]:
        """What it puts out by now, V."""
        hertz, volts, on = 0.0, 0.0, False
        for what, *said in self.told:
            on = (on or what == "start") and what != "off"
            if what in ("arm_sine", "set_frequency"):
                hertz = float(str(said[0]))
            if what in ("arm_sine", "set_amplitude"):
                volts = float(str(said[what == "arm_sine"]))
        return on * volts * np.sin(2 * np.pi * hertz * seconds)

    def open(self) -> None:
        self._note("open")

    def close(self) -> None:
        self._note("close")

    def arm_sine(self, frequency_hz: float, amplitude_v: float, offset_v: float, *, triggered: bool) -> None:
        self._note("arm_sine", frequency_hz, amplitude_v, offset_v, triggered)

    def start(self) -> None:
        self._note("start")

    def set_frequency(self, frequency_hz: float) -> None:
        self._note("set_frequency", frequency_hz)

    def set_amplitude(self, amplitude_v: float) -> None:
        self._note("set_amplitude", amplitude_v)

    def set_offset(self, offset_v: float) -> None:
        self._note("set_offset", offset_v)

    def check(self) -> None:
        pass

    def off(self) -> None:
        self._note("off")

    def _note(self, *what: object) -> None:
        self.told.append(what)
        if what[0] == self._fails_at:
            raise InstrumentSilent(self.name, self.address, "no answer")


class SteppedCard:
    """A card whose blocks come one by one, as the test lets them; row k of sample n is `values(n, k)`."""

    name, address, warnings, sample_rate = "card", FAKE, (), RATE

    def __init__(
        self,
        channels: tuple[Channel, ...],
        values: Callable[[NDArray[np.int64], int], NDArray[np.float64]] = lambda n, k: n + 1000.0 * k,
        flags: Callable[[int], Flag] = lambda block: Flag.GOOD,
    ) -> None:
        self.channels = channels
        self._values, self._flags = values, flags
        self._allowed = threading.Semaphore(0)
        self._next = self._block = 0
        self.stopped = False

    def let(self, blocks: int = 1) -> None:
        """Let that many blocks come."""
        self._allowed.release(blocks)

    def arm(self) -> None:
        pass

    def start(self) -> None:
        self._next = 0

    def started_s(self) -> float | None:
        return None

    def read(self, count: int) -> CardReading:
        if not self._allowed.acquire(timeout=10):
            raise InstrumentSilent(self.name, self.address, "no block was let through")
        samples = np.arange(self._next, self._next + count)
        self._next += count
        values = np.stack([self._values(samples, row) for row in range(len(self.channels))])
        flags = (self._flags(self._block),) * len(self.channels)
        self._block += 1
        return CardReading(int(samples[0]), values, flags, SystemClock().monotonic_s())

    def stop(self) -> None:
        self.stopped = True


class Kept:
    """A consumer that keeps what it is given, in order."""

    def __init__(self, fails_on: type | None = None) -> None:
        self.records: list[Record] = []
        self._fails_on = fails_on

    def __call__(self, record: Record) -> None:
        if self._fails_on is not None and isinstance(record, self._fails_on):
            raise ZeroDivisionError("a fault in a consumer")
        self.records.append(record)

    def of(self, *origins: Origin) -> list[SampleBlock]:
        return [each.samples for each in self.records if isinstance(each, Block) and each.origin in origins]

    def blocks(self, channel: str) -> list[SampleBlock]:
        blocks = (each.samples for each in self.records if isinstance(each, Block))
        return [block for block in blocks if block.channel == channel]

    @property
    def impacts(self) -> list[Impact]:
        return [each for each in self.records if isinstance(each, Impact)]

    @property
    def events(self) -> list[Event]:
        return [each for each in self.records if isinstance(each, Event)]

    @property
    def gaps(self) -> list[Gap]:
        return [each for each in self.records if isinstance(each, Gap)]

    def codes(self) -> list[str]:
        return [event.code for event in self.events]
