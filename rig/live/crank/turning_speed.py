"""Speed of a crank while a run lasts: what the log has as `/derived/crank.speed`, by the same code."""

from __future__ import annotations

from collections import deque
from math import tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.angle.crank_cycles import MarkerCycles
from daq.angle.speed import AngleSpeed, MarkerSpeed, Run, samples_per_speed
from daq.block import SampleBlock

_RAD_S_PER_RPM = tau / 60.0
_MOST = 500
"""Speeds that wait to be shown: 10 s."""


class Speeds(NamedTuple):
    """Speeds in rad/s at times in s since sample 0; both of shape (n,)."""

    time_s: NDArray[np.float64]
    speed_rad_s: NDArray[np.float64]


class TurningSpeed:
    """Speeds from a crank's angle in rad, or from its marker in V; a stream that goes back starts afresh."""

    def __init__(self, by_marker: bool) -> None:
        self._by_marker = by_marker
        self._end = -1
        self._known: deque[tuple[float, float]] = deque(maxlen=_MOST)

    def add(self, block: SampleBlock) -> None:
        """Take a block of the channel."""
        if not 0 <= self._end <= block.first_sample:
            self._begin(block)
        self._end = block.end_sample
        rate, every = block.sample_rate, samples_per_speed(block.sample_rate)
        for first, speeds in self._read(block):
            times = ((first + np.arange(len(speeds)) + 0.5) * every - 0.5) / rate
            rows = zip(times.tolist(), (speeds * _RAD_S_PER_RPM).tolist(), strict=True)
            self._known.extend(row for row in rows if np.isfinite(row[1]))

    def take(self) -> Speeds:
        """Return what has become known since the last call; of very many, the newest."""
        rows = np.array(self._known, np.float64).reshape(-1, 2)
        self._known.clear()
        return Speeds(rows[:, 0], rows[:, 1])

    def _begin(self, block: SampleBlock) -> None:
        rate, every = block.sample_rate, samples_per_speed(block.sample_rate)
        self._cycles = MarkerCycles(rate)
        self._angle = AngleSpeed(rate, every)
        self._marker = MarkerSpeed(self._cycles, rate, every, block.first_sample)

    def _read(self, block: SampleBlock) -> list[Run]:
        if not self._by_marker:
            return self._angle.add(block.first_sample, block.values)
        self._cycles.add(block.first_sample, block.values)
        return self._marker.take(block.end_sample)
