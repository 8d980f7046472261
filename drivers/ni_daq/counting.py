"""From the raw readings of a counter to angle, marks and speed; exact over the counter's rollover."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Decoder: TypeAlias = Callable[[NDArray[Any]], NDArray[np.float64]]
"""Takes the consecutive blocks of one task, each of shape (n,), and gives the channel's values."""

COUNTER_STATES = 2**32


class UnwrappedCount:
    """The whole count behind a 32-bit counter that starts at 0 as int64, forwards and backwards.

    `modulus` is after how many counts it repeats; steps of less than half of that come out exactly. The first
    count lies from `lowest` on.
    """

    def __init__(self, modulus: int = COUNTER_STATES, lowest: int = -COUNTER_STATES // 2) -> None:
        self._modulus, self._lowest = modulus, lowest
        self._last: tuple[int, int] | None = None

    def __call__(self, raw: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Return the counts of the next block, shape (n,)."""
        register = raw.view(np.int32).astype(np.int64)
        if not len(register):
            return register
        first = int(register[0])
        before, count = self._last or (first, (first - self._lowest) % self._modulus + self._lowest)
        half = self._modulus // 2
        steps = (np.diff(register, prepend=before) + half) % self._modulus - half
        counts = count + np.cumsum(steps)
        self._last = int(register[-1]), int(counts[-1])
        return counts


def angle(counts: UnwrappedCount, rad_per_count: float) -> Decoder:
    """Unwrapped angle in rad."""
    return lambda raw: np.multiply(counts(raw), rad_per_count, dtype=np.float64)


class MarkPulses:
    """A marker whose edges a counter counts: `level` (V) at each sample that follows an edge, else 0.

    A mark shorter than a sample is not missed; two between two samples look like one.
    """

    def __init__(self, level: float) -> None:
        self._level = level
        self._counts = UnwrappedCount()
        self._last = 0

    def __call__(self, raw: NDArray[np.uint32]) -> NDArray[np.float64]:
        """Return the next block in V, shape (n,)."""
        counts = self._counts(raw)
        rising = np.diff(counts, prepend=self._last) > 0
        self._last = int(counts[-1]) if len(counts) else self._last
        return np.where(rising, self._level, 0.0)


def speed(rad_per_pulse: float) -> Decoder:
    """Speed in rad/s from the frequency of pulses in Hz."""
    return lambda frequency_hz: frequency_hz * rad_per_pulse
