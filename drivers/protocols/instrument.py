"""What all instruments that are asked by name have in common, those that move the rig, and those that only
measure beside the card; and that those without encryption are reached on this machine only."""

from __future__ import annotations

import re
import socket
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, Protocol

from daq.channel import Channel
from daq.clock import Clock

LOOPBACK_HOSTS: Final = ("127.0.0.1", "localhost", "[::1]", "::1")  # of a port without a password
TUNNEL: Final = "127.0.0.1 (nothing is encrypted; reach other machines by an SSH tunnel)"
_PORTS: Final = range(1, 65536)
MOST_NOTICES: Final = 1000
"""That wait to be taken: nobody may ask for them, and the oldest go then."""
HOST: Final = re.compile(r"(tcpip\d*::|socket://)([^:/,]+)", re.IGNORECASE)
"""How an address over a network begins."""


def misplaced(address: str) -> str | None:
    """What may stand in place of `host:port`; None where it is on loopback."""
    host, _, port = address.rpartition(":")
    if host not in LOOPBACK_HOSTS:
        return f"{TUNNEL} and a port"
    return None if int(port) in _PORTS else "a port from 1 to 65535"


def by_number(address: str) -> str:
    """An address with its host as a number; as it is written where it has none, or nobody knows it now.

    Who has to reach it at once asks no server for its name, which may be behind the very switch that is gone.
    """
    if (place := HOST.match(address)) is not None:
        with suppress(OSError, UnicodeError):  # what is no name of a host either
            return f"{place[1]}{socket.gethostbyname(place[2])}{address[place.end() :]}"
    return address


class Instrument(Protocol):
    """An instrument as the bench and the log name it."""

    @property
    def name(self) -> str:
        """What the bench calls it."""

    @property
    def address(self) -> str:
        """Where it is."""

    @property
    def identity(self) -> str:
        """What it says it is; empty before `open`."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Something for the log: `level` is info, warning or error, `code` is stable, `text` is for people.

    `arrival_s` is when this machine heard of it, by the monotonic clock: the run knows what time that was.
    """

    arrival_s: float
    level: str
    code: str
    text: str


class Notices:
    """Notices with their time, until they are taken. One thread writes, another may take."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._kept: deque[Notice] = deque(maxlen=MOST_NOTICES)

    def note(self, level: str, code: str, text: str) -> None:
        self._kept.append(Notice(self._clock.monotonic_s(), level, code, text))

    def take(self) -> tuple[Notice, ...]:
        return tuple(self._kept.popleft() for _ in range(len(self._kept)))


class Actuator(Instrument, Protocol):
    """An instrument that moves the rig.

    Every method may raise `InstrumentRefused` (it said no, or a limit of ours forbids it), `InstrumentSilent`
    (no answer in time) and, once open, `DeviceLost`.
    """

    def open(self) -> None:
        """Connect and check the model; moves nothing. Raises `InstrumentAbsent` as well."""

    def close(self) -> None:
        """Hang up. Never raises."""

    def off(self) -> None:
        """Go to the safe state; no error where it is there or closed already."""


class ActuatorOutput(Protocol):
    """What an actuator puts out, as an emulated one tells it to a plant at every change."""

    @property
    def started_s(self) -> float:
        """Since when, in s of the monotonic clock (`SystemClock`), which all processes share."""


class Logger(Instrument, Protocol):
    """An instrument that is asked now and then for what changes slowly; nothing that moves hangs on it."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What it measures, in the order of a reading; none may be called as a channel of the rig."""

    @property
    def period_s(self) -> float:
        """Time between two readings, s."""

    def open(self) -> None:
        """Connect and check. Raises `InstrumentAbsent`, `InstrumentRefused`, `InstrumentSilent`."""

    def close(self) -> None:
        """Hang up. Never raises."""

    def read(self) -> Sequence[float]:
        """What its channels show now, in their units; answers within seconds, in one thread of its own.

        Raises `InstrumentSilent` where no answer came in time: it is asked again. Any other `RattleError` is
        the last that is heard of it.
        """
