"""What a bench declares between a sensor and its card, as it shapes a signal: in time and by frequency.

Sensor's resonance, high-passes of first order (a charge amplifier's, an IEPE sensor's), the largest output
of the amplifier, and a Butterworth low-pass (Butterworth, Wireless Engineer 7 (1930), 536): poles of
damping ratio sin((2 k - 1) pi / 2 n) on one circle. All of them causal: what a stage delays comes late.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import inf, pi, sin, tan

import numpy as np
from numpy.typing import NDArray

from sim_twin.linear_filter import LinearFilter, resonance

Array = NDArray[np.float64]
_BAND = 0.45
"""Of the rate: what a low-pass takes away beyond, nobody sees."""


@dataclass(frozen=True, slots=True)
class Section:
    """A low-pass of second order with a `damping_ratio`, or of first order without one; or a high-pass."""

    corner: float
    damping_ratio: float | None = None
    high: bool = False

    def response(self, frequency: Array) -> NDArray[np.complex128]:
        """At frequencies in Hz, same shape."""
        s = 1j * frequency / self.corner
        if self.damping_ratio is not None:
            return np.asarray(1 / (1 + 2 * self.damping_ratio * s + s**2))
        return np.asarray((s if self.high else 1.0) / (1 + s))

    @property
    def delay(self) -> float:
        """Of slow signals, in s; a high-pass has none to tell of."""
        if self.high:
            return 0.0
        return (2 * self.damping_ratio if self.damping_ratio is not None else 1.0) / (2 * pi * self.corner)

    def filter(self, rate: float) -> LinearFilter:
        """By the bilinear transform, true at the corner (Oppenheim and Schafer, 3rd edition, 7.2.2)."""
        k = tan(pi * self.corner / rate)
        if self.damping_ratio is None:
            b = np.array([1.0, -1.0]) if self.high else np.array([k, k])
            return LinearFilter(b, np.array([1 + k, k - 1]))
        twist = 2 * self.damping_ratio * k
        return LinearFilter(
            k**2 * np.array([1.0, 2.0, 1.0]), np.array([1 + twist + k**2, 2 * (k**2 - 1), 1 - twist + k**2])
        )


@dataclass(frozen=True, slots=True)
class Stages:
    """In the order of the signal: `resonance` of the sensor, frequency in Hz and damping ratio; the corners
    `high_passes` in Hz; `output`, the largest magnitude that the amplifier gives; `low_pass`, corner in Hz
    and order; `late`, by how much (s) the input shows later than a counter what happens; `floor`, the rms of
    the input's own noise.

    Magnitudes are in the channel's unit.
    """

    resonance: tuple[float, float] | None = None
    high_passes: tuple[float, ...] = ()
    output: float = inf
    low_pass: tuple[float, int] | None = None
    late: float = 0.0
    floor: float = 0.0

    @property
    def before(self) -> tuple[Section, ...]:
        """Up to the amplifier's output."""
        own = () if self.resonance is None else (Section(*self.resonance),)
        return (*own, *(Section(corner, high=True) for corner in self.high_passes))

    @property
    def after(self) -> tuple[Section, ...]:
        """Behind it."""
        if self.low_pass is None:
            return ()
        corner, order = self.low_pass
        pairs = (sin((2 * k - 1) * pi / (2 * order)) for k in range(1, order // 2 + 1))
        odd = (Section(corner),) if order % 2 else ()
        return (*odd, *(Section(corner, damping_ratio) for damping_ratio in pairs))

    @property
    def delay(self) -> float:
        """Of slow signals, in s."""
        return self.late + sum(section.delay for section in (*self.before, *self.after))

    def response(self, frequency: float) -> complex:
        """Of all of them to what reaches no limit, at a frequency in Hz."""
        sections = (*self.before, *self.after)
        passed = np.prod([section.response(np.array(frequency)) for section in sections])
        return complex(passed * np.exp(-2j * pi * frequency * self.late))


class StageStream:
    """The stages in motion, from rest: finely sampled blocks in, blocks of the same length out."""

    def __init__(self, stages: Stages, rate: float, output: float) -> None:
        # what resonates may do so beyond half the rate, where no transform of its corner leads
        own = [] if stages.resonance is None else [resonance(*stages.resonance, rate)]
        self._before = [*own, *(each.filter(rate) for each in stages.before if each.high)]
        self._after = [each.filter(rate) for each in stages.after if each.corner < _BAND * rate]
        self._output = output

    def __call__(self, signal: Array) -> Array:
        for passed in self._before:
            signal = passed(signal)
        signal = np.clip(signal, -self._output, self._output)
        for passed in self._after:
            signal = passed(signal)
        return signal


@lru_cache(maxsize=32)
def responses(
    stages: Stages, count: int, resolution: float
) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
    """Before and after the amplifier's output, at `count` multiples of `resolution` (Hz); never changed."""
    frequency = resolution * np.arange(count, dtype=np.float64)
    parts = []
    for sections in (stages.before, stages.after):
        whole = np.ones(count, np.complex128)
        for section in sections:
            whole *= section.response(frequency)
        parts.append(whole)
    parts[1] *= np.exp(-2j * pi * stages.late * frequency)
    return parts[0].astype(np.complex64), parts[1].astype(np.complex64)
