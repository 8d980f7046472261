"""A friction damper whose ends are moved: Coulomb's law, and whatever it lacks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
_SHORTEST = 1e-6
"""m; a rigid damper gives way by this before it slides, less than any record shows."""


@dataclass(frozen=True, slots=True)
class Damper:
    """Forces in units of the sliding force; what is 0 is missing in Coulomb's law.

    Before it slides, the damper gives way by `give` (m) on elastic parts and, after the ends have moved
    through a `play` (m), by `contact_give` on what touches there (Hertz: with the force to the power 2/3).
    Friction is larger by `rest` at rest than when faster than `slow` (m/s); by `viscous` at 0.1 m/s; by
    `uneven` to one side than to the other; by `outwards` 25 mm from the middle, with the square of that
    distance. `spring` (at 25 mm) and `mass` (at 1 m/s2) are carried along. The force is shown with an
    `offset` and comes late by `delay` (s).
    """

    give: float = 0.0
    contact_give: float = 0.0
    play: float = 0.0
    rest: float = 0.0
    slow: float = 1.0
    viscous: float = 0.0
    uneven: float = 0.0
    outwards: float = 0.0
    spring: float = 0.0
    mass: float = 0.0
    offset: float = 0.0
    delay: float = 0.0

    def force(self, x: Array, rate: float, bumps: Array) -> Array:
        """Force on moved ends, x (m) at `rate` (Hz); friction is larger by `bumps` wherever that is."""
        speed = np.gradient(x, 1 / rate)
        sliding = self._sliding(x, speed) * (1 + bumps)
        force = _creep(x, sliding, self.give + _SHORTEST, self.contact_give, 0.5 * self.play)
        force += self.spring * x / 0.025 + self.mass * np.gradient(speed, 1 / rate) + self.offset
        times = np.arange(len(x)) / rate
        return np.asarray(np.interp(times - self.delay, times, force))

    def _sliding(self, x: Array, speed: Array) -> Array:
        fast = np.abs(speed)
        friction = 1 + self.rest * np.exp(-fast / self.slow) + self.viscous * fast / 0.1
        return friction * (1 + 0.5 * self.uneven * np.sign(speed)) * (1 + self.outwards * (x / 0.025) ** 2)


@njit(cache=True)
def _creep(x: Array, sliding: Array, give: float, contact_give: float, half_play: float) -> Array:
    """A friction element behind a spring that has play; it slides by what the spring cannot bear."""
    force = np.zeros(len(x))
    slid = x[0]
    for k in range(len(x)):
        most = max(sliding[k], 0.0)
        reach = half_play + contact_give * most ** (2 / 3) + give * most
        stretch = x[k] - slid
        if abs(stretch) > reach:
            slid += np.sign(stretch) * (abs(stretch) - reach)
            stretch = np.sign(stretch) * reach
        force[k] = np.sign(stretch) * _borne(abs(stretch) - half_play, give, contact_give)
    return force


@njit(cache=True)
def _borne(bent: float, give: float, contact_give: float) -> float:
    """Force at which both springs together give way by so much: Newton's steps for its cubic root."""
    if bent <= 0.0:
        return 0.0
    root = (bent / give) ** (1 / 3)
    for _ in range(40):
        left = give * root**3 + contact_give * root**2 - bent
        if left < 1e-9 * bent:
            break
        root -= left / (3 * give * root**2 + 2 * contact_give * root)
    return float(root**3)
