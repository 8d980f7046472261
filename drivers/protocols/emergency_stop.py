"""The emergency stop as this program knows it: a line that is read and heeded, and never written.

What stops the machine is the hard-wired chain, with this program or without it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Final, Literal, Protocol

from daq.clock import Clock
from daq.errors import EmergencyStop, InstrumentError, InstrumentSilent
from daq.quantity import Key, Text

STOP_TABLE: Final = "emergency_stop"
LOOK_S: Final = 0.02  # as the guard of a run looks
SILENCE_S: Final = 0.5
"""25 looks, of something that waits for nothing: only what is frozen misses as many."""
_UNREAD: Final = round(SILENCE_S / LOOK_S)
"""Looks without a reading, of which a machine that stands still takes nothing."""
_LATE, _FORGIVEN_S = 4, 10.0
"""Late answers, from which on nobody knows how late a line is seen; one is forgotten in so many s."""
_LEFT_S: Final = 0.5
"""How long a reading that is under way is waited for at the end; one that hangs is left behind."""


@dataclass(frozen=True, slots=True)
class StopLine:
    """The table [emergency_stop] of a bench: where a contact of the hard-wired chain is read.

    `line` is a digital input of the card, or a terminal of the inverter. A normally closed contact opens
    where it is pressed, and its line where a wire breaks.
    """

    line: Annotated[
        str,
        Text(
            'a digital input of the card, such as "cDAQ1Mod4/port0/line0", or a terminal of the inverter, '
            'such as "inverter/RH"',
            r"inverter/[A-Z]{1,4}|(?!inverter/)[A-Za-z0-9_.-]+/port\d{1,3}/line\d{1,3}",
        ),
    ]
    contact: Annotated[Literal["normally closed", "normally open"], Key()] = "normally closed"

    @property
    def terminal(self) -> str:
        """Of the inverter; empty for a line of the card."""
        return self.line.partition("inverter/")[2]

    @property
    def healthy(self) -> bool:
        """Whether its input is on while nobody presses it."""
        return self.contact == "normally closed"

    def at(self, address: str) -> str:
        """Where it is, on the instrument at an address."""
        return f"{self.line} of {address}"

    def heed(self, on: bool, address: str) -> None:
        """Raise EmergencyStop unless the input is as a healthy line has it."""
        if on != self.healthy:
            raise EmergencyStop(self.at(address), "its line is open", time.monotonic())


class LineReader(Protocol):
    """Reads a line of the card; one of the inverter is read by who polls that."""

    @property
    def address(self) -> str:
        """Where it is."""

    def open(self) -> None:
        """Connect. Raises any `InstrumentError`."""

    def heed(self) -> None:
        """Read it. Raises EmergencyStop where it is open, another `InstrumentError` where it is not read."""

    def close(self) -> None:
        """Hang up. Never raises."""


def refuse_open(make: Callable[[], LineReader]) -> None:
    """Read the line once; raises as `LineReader` does."""
    reader = make()
    try:
        reader.open()
        reader.heed()
    finally:
        reader.close()


class LineWatch:
    """Reads a line every 20 ms, in a thread of its own, for a driver may hang. What it sees stays seen."""

    def __init__(self, make: Callable[[], LineReader], clock: Clock) -> None:
        self._reader, self._clock = make(), clock
        self._thread = threading.Thread(target=self._read, name="emergency stop", daemon=True)
        self._seen: EmergencyStop | None = None
        self._ended = False
        self._unread, self._looked_s = 0, clock.monotonic_s()  # looks since the last reading; the last one
        self._late, self._late_s = 0.0, -math.inf  # answers, and when the last of them was

    def __enter__(self) -> LineWatch:
        try:
            self._reader.open()
            self._heed()
        except InstrumentError as error:
            self._see(error)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended = True
        self._thread.join(_LEFT_S)
        self._reader.close()

    def look(self) -> EmergencyStop | None:
        """What was seen; to be called every 20 ms. A line of which no reading comes counts as open."""
        if (now_s := self._clock.monotonic_s()) - self._looked_s >= LOOK_S:
            self._looked_s, self._unread = now_s, self._unread + 1
        if self._unread > _UNREAD and self._seen is None:
            what, check = "its line gives no reading", "the card that reads it, its driver or device server"
            self._seen = EmergencyStop.unread(self._reader.address, what, now_s, check)
        return self._seen

    def _read(self) -> None:
        while self._seen is None and not self._ended:
            try:
                self._heed()
            except InstrumentError as error:
                self._see(error)
            self._clock.sleep(LOOK_S)

    def _heed(self) -> None:
        """Read it. One late answer may be of a busy machine: `look` counts how long there is none."""
        try:
            self._reader.heed()
        except InstrumentSilent:
            now_s = self._clock.monotonic_s()
            forgotten = (now_s - self._late_s) / _FORGIVEN_S
            self._late, self._late_s = max(self._late - forgotten, 0.0) + 1.0, now_s
            if self._late > _LATE - 1:
                raise
            return
        self._unread = 0  # no lock: at worst one of these is lost, and the next counts

    def _see(self, error: InstrumentError) -> None:
        if not isinstance(error, EmergencyStop):
            what, now_s = f"its line cannot be read: {error.what}", self._clock.monotonic_s()
            error = EmergencyStop.unread(self._reader.address, what, now_s, error.check)
        self._seen = error
