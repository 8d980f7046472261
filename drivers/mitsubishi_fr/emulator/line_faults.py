"""What a bad line makes of good answers, by a seeded schedule."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from drivers.mitsubishi_fr.frames import checksum

LATE_S = (0.22, 0.5)  # an answer is given up after 0.2 s
_BUSY = 0x06  # Modbus exception: server device busy


@dataclass(frozen=True, slots=True)
class LineFaults:
    """The share of answers that are spoilt, each in one of `kinds` (names in `KINDS`) by lot."""

    share: float = 0.0
    kinds: tuple[str, ...] = ("drop", "flip")
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Piece:
    """Bytes that reach the master `delay_s` after the drive sent its answer, or after what went before."""

    delay_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Exchange:
    """A request, its answer, the answer before that, and the lot that is drawn for it."""

    request: bytes
    answer: bytes
    previous: bytes
    lot: random.Random


class Disturbance:
    """Spoils answers one after another, each by the first of `faults` whose lot it is.

    KeyError for a kind that is not in `KINDS`.
    """

    def __init__(self, *faults: LineFaults) -> None:
        self.faults = faults
        self._kinds = [(each.share, [KINDS[kind] for kind in each.kinds]) for each in faults]
        self._lot = random.Random(faults[0].seed)  # noqa: S311 - a schedule, no secret
        self._previous = b""

    def spoil(self, request: bytes, answer: bytes) -> Piece:
        """Return what arrives of the answer to a request."""
        exchange = Exchange(request, answer, self._previous, self._lot)
        self._previous = answer
        for share, kinds in self._kinds:
            if self._lot.random() < share:
                return self._lot.choice(kinds)(exchange)
        return Piece(0.0, answer)


def _flipped(exchange: Exchange) -> Piece:
    # The CRC finds every error of up to three bits; it lets one in 65536 of larger ones through.
    bits = exchange.lot.sample(range(8 * len(exchange.answer)), exchange.lot.randint(1, 3))
    flipped = bytearray(exchange.answer)
    for bit in bits:
        flipped[bit // 8] ^= 1 << bit % 8
    return Piece(0.0, bytes(flipped))


def _signed(body: bytes) -> bytes:
    return body + checksum(body)


KINDS: dict[str, Callable[[Exchange], Piece]] = {
    "drop": lambda exchange: Piece(0.0, b""),
    "flip": _flipped,
    "cut": lambda exchange: Piece(0.0, exchange.answer[: exchange.lot.randrange(1, len(exchange.answer))]),
    "garbage": lambda exchange: Piece(
        0.0, exchange.lot.randbytes(exchange.lot.randrange(1, 9)) + exchange.answer
    ),
    "echo": lambda exchange: Piece(0.0, exchange.request + exchange.answer),
    "echo alone": lambda exchange: Piece(0.0, exchange.request),
    "twice": lambda exchange: Piece(0.0, exchange.answer + exchange.answer),
    "stale": lambda exchange: Piece(0.0, exchange.previous),  # an answer has no name to tell it by (0007)
    "old first": lambda exchange: Piece(0.0, exchange.previous + exchange.answer),
    "late": lambda exchange: Piece(exchange.lot.uniform(*LATE_S), exchange.answer),
    "other station": lambda exchange: Piece(
        0.0, _signed(bytes([exchange.answer[0] ^ 1]) + exchange.answer[1:-2])
    ),
    "busy": lambda exchange: Piece(
        0.0, _signed(bytes([exchange.answer[0], exchange.answer[1] | 0x80, _BUSY]))
    ),
}
