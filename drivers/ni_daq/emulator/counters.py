"""The emulated counters: from what the plant shows at each sample clock edge to what the register holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from drivers.ni_daq.emulator.wiring import CounterWire

Measure: TypeAlias = Callable[[NDArray[np.float64]], NDArray[Any]]
"""Takes consecutive blocks of the plant's row, shape (n,), gives the counter's readings."""

COUNTER_STATES = 2**32
_HYSTERESIS = 0.2  # of the threshold, to either side
_COUNT_ROUNDING = 1e-6  # of a count: an angle that is a whole number of counts came from a product in floats


@dataclass(frozen=True, slots=True)
class CounterInput:
    """A counter as the client declared it; `measure` begins a measurement on a wire."""

    physical: str
    measure: Callable[[CounterWire], Measure]
    dtype: type[np.generic] = np.uint32


class AngleCount:
    """A quadrature encoder: `decoding` counts a pulse from `initial` on, set to `at_index` by the index mark.

    `at_index` is None where the client leaves the index alone. The mark sits at whole turns of the plant's
    angle, and is passed in the middle of a step as well.
    """

    def __init__(self, wire: CounterWire, decoding: int, initial: int, at_index: int | None) -> None:
        self._per_turn = wire.pulses_per_revolution * decoding
        self._shift = wire.preset + initial
        self._at_index = at_index
        self._origin: int | None = None
        self._last = 0

    def __call__(self, angle: NDArray[np.float64]) -> NDArray[np.uint32]:
        """Return the register at each sample."""
        place = np.floor(angle * (self._per_turn / math.tau) + _COUNT_ROUNDING).astype(np.int64)
        if self._origin is None:
            self._origin = self._last = int(place[0])
        register = place - self._origin + self._shift
        if self._at_index is not None:
            register = self._set_by_mark(place, register, self._at_index)
        self._last = int(place[-1])
        return (register % COUNTER_STATES).astype(np.uint32)

    def _set_by_mark(
        self, place: NDArray[np.int64], register: NDArray[np.int64], at_index: int
    ) -> NDArray[np.int64]:
        before = np.concatenate([[self._last], place[:-1]])
        forwards, backwards = place // self._per_turn, -(-place // self._per_turn)
        passed = np.where(
            place >= before, forwards > before // self._per_turn, backwards < -(-before // self._per_turn)
        ) | (place % self._per_turn == 0)
        mark = np.where(place >= before, forwards, backwards) * self._per_turn
        last = np.maximum.accumulate(np.where(passed, np.arange(len(place)), -1))
        if last[-1] >= 0:
            self._origin, self._shift = int(mark[last[-1]]), at_index
        return np.where(last >= 0, place - mark[last] + at_index, register)


class EdgeCount:
    """Rising edges of a marker so far."""

    def __init__(self, wire: CounterWire) -> None:
        self._low = wire.threshold_v * (1.0 - _HYSTERESIS)
        self._high = wire.threshold_v * (1.0 + _HYSTERESIS)
        self._up: bool | None = None
        self._count = wire.preset

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.uint32]:
        """Return the register at each sample."""
        # The comparator's output: in between it stays as it was.
        decided = np.where(volts >= self._high, 1, np.where(volts <= self._low, 0, -1))
        where = np.maximum.accumulate(np.where(decided >= 0, np.arange(len(volts)), -1))
        up = np.where(where >= 0, decided[where] == 1, bool(self._up))
        edges = np.diff(up.astype(np.int8), prepend=np.int8(up[0] if self._up is None else self._up)) > 0
        counts = self._count + np.cumsum(edges)
        self._up, self._count = bool(up[-1]), int(counts[-1])
        return (counts % COUNTER_STATES).astype(np.uint32)


def pulse_frequency(wire: CounterWire) -> Measure:
    """Frequency in Hz of the pulses of a shaft whose speed in rad/s the plant gives."""
    return lambda speed: np.abs(speed) * (wire.pulses_per_revolution / math.tau)
