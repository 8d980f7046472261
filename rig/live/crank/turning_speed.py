"""Speed of a crank while a run lasts."""

from __future__ import annotations

from math import tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.live.crank.turns import Turns

STEP_S = 0.02
"""A speed is the mean over this stretch: a fifteenth of a turn at 200 rpm, 270 counts of an encoder."""


class Speeds(NamedTuple):
    """Mean speeds in rad/s in the middle of stretches, at times in s since sample 0; both of shape (n,)."""

    time_s: NDArray[np.float64]
    speed_rad_s: NDArray[np.float64]


class TurningSpeed:
    """Speeds over even stretches of time; none where turns are not known."""

    def __init__(self) -> None:
        self._next = 0  # stretch, counted from sample 0

    def follow(self, turns: Turns, sample_rate: float, most: int = 500) -> Speeds:
        """The speeds that are known by now and have not been told; of more than `most`, the newest."""
        step = STEP_S * sample_rate
        end = int(turns.known_until / step)
        first = max(min(self._next, end), end - most)
        self._next = end
        edges = np.round(np.arange(first, end + 1) * step).astype(np.int64)
        edges[-1:] = np.minimum(edges[-1:], turns.known_until - 1)
        way, passed = np.diff(turns.at(edges)), np.diff(edges)
        known = np.isfinite(way) & (passed > 0)
        middle = (edges[:-1] + edges[1:]) / 2
        return Speeds(middle[known] / sample_rate, tau * way[known] * sample_rate / passed[known])
