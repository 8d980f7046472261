"""A driven oscillator with whatever a linear one lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import resample

Array = NDArray[np.float64]
_OVERSAMPLING = 4
"""An input without content above half its rate is known between its samples; steps are two of these long."""


@dataclass(frozen=True, slots=True)
class Circuit:
    """Hz, share of critical damping, output over input (V/V) at rest; a linear one has none of the others.

    The spring's force is w2 (x + quadratic x2 + cubic x3) of x beyond a `dead` zone (V). Damping grows by
    `damping_2` and `damping_3` of itself, with the first and second power of the rate, until that is w times
    0.05 V; `friction` is in V of the input. What is shown bends towards a `limit` (V), is multiplied by
    `output` and comes late by `delay` (s).
    """

    frequency: float
    damping: float
    gain: float
    quadratic: float = 0.0
    cubic: float = 0.0
    dead: float = 0.0
    damping_2: float = 0.0
    damping_3: float = 0.0
    friction: float = 0.0
    limit: float = np.inf
    output: float = 1.0
    delay: float = 0.0

    def respond(self, u: Array, rate: float) -> Array:
        """What it does from rest on an input (V), sampled at `rate` (Hz), shape (n,)."""
        fine: Array = resample(u, _OVERSAMPLING * len(u))
        spring = (self.quadratic, self.cubic, self.dead)
        damper = (2 * self.damping, self.damping_2, self.damping_3, self.friction)
        return _respond(self.gain * fine, 2 * pi * self.frequency / rate, spring, damper)

    def shown(self, y: Array, rate: float) -> Array:
        """What its output shows of it."""
        bent: Array = self.limit * np.tanh(y / self.limit) if np.isfinite(self.limit) else y
        return self.output * filtered(bent, rate, lambda f: np.exp(-2j * pi * f * self.delay))


def filtered(x: Array, rate: float, response: Callable[[Array], NDArray[np.complex128]]) -> Array:
    """A record through a filter with the given frequency response (of Hz)."""
    frequencies = np.arange(len(x) // 2 + 1) * rate / len(x)
    return np.asarray(np.fft.irfft(response(frequencies) * np.fft.rfft(x), len(x)))


@njit(cache=True)
def _respond(
    u: Array, w: float, spring: tuple[float, float, float], damper: tuple[float, float, float, float]
) -> Array:
    """Runge and Kutta's classical steps, two a sample; time in samples."""
    found = np.zeros(len(u) // 4)
    x, v, step = 0.0, 0.0, 0.5 * w
    for k in range(2 * len(found) - 1):
        if k % 2 == 0:
            found[k // 2] = x
        a1 = _acceleration(x, v, u[2 * k], spring, damper)
        v2 = v + 0.5 * step * a1
        a2 = _acceleration(x + 0.5 * step * v, v2, u[2 * k + 1], spring, damper)
        v3 = v + 0.5 * step * a2
        a3 = _acceleration(x + 0.5 * step * v2, v3, u[2 * k + 1], spring, damper)
        v4 = v + step * a3
        a4 = _acceleration(x + step * v3, v4, u[2 * k + 2], spring, damper)
        x += step * (v + 2 * v2 + 2 * v3 + v4) / 6
        v += step * (a1 + 2 * a2 + 2 * a3 + a4) / 6
    return found


@njit(cache=True)
def _acceleration(
    x: float,
    v: float,
    u: float,
    spring: tuple[float, float, float],
    damper: tuple[float, float, float, float],
) -> float:
    """In units of w: the rate `v` is that of a phase."""
    quadratic, cubic, dead = spring
    linear, second, third, friction = damper
    stretched = np.sign(x) * max(abs(x) - dead, 0.0)
    fast = abs(v) / 0.05
    force = stretched * (1 + quadratic * x + cubic * x * x)
    return float(
        u - force - linear * v * (1 + second * fast + third * fast * fast) - friction * np.tanh(v / 1e-3)
    )
