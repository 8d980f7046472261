"""Edges of an analog pulse between two samples, block by block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.errors import UnphysicalParameter

Array = NDArray[np.float64]

LOW_V, HIGH_V = 1.5, 3.5
"""For a mark of 0 and 5 V: far above its noise (0.02 V rms), and above the ringing of an anti-alias filter,
which swings by 9 % of a step."""


@dataclass(slots=True)
class _Passage:
    """What the next block must know of those before: values so far seen, the last one, the last rise."""

    count: int = 0
    last_v: float = np.nan
    is_high: bool | None = None
    last_low: int = -1
    crossing: float = np.nan


class Edges(NamedTuple):
    """Where edges lie (sample index from the first sample on) and the sample that made each certain; shape
    (m,)."""

    position: Array
    confirmed: NDArray[np.intp]


class RisingEdges:
    """Finds rising edges; how the samples are cut into blocks makes no difference.

    An edge counts once the signal, having been below `low_v`, is above `high_v`; it lies where the straight
    line between two samples passes the middle of the two. A signal that starts high has no edge there.
    Samples that are not finite are neither.
    """

    def __init__(self, low_v: float = LOW_V, high_v: float = HIGH_V) -> None:
        if not low_v < high_v:
            raise UnphysicalParameter(
                "marker", "lower threshold", low_v, f"below the upper one, {high_v:g} V"
            )
        self._low_v, self._high_v = low_v, high_v
        self._middle_v = (low_v + high_v) / 2
        self._passage = _Passage()

    @property
    def count(self) -> int:
        """Samples seen so far."""
        return self._passage.count

    def find(self, values_v: ArrayLike) -> Edges:
        """Edges that the next samples (V, shape (n,)) make certain."""
        values = np.asarray(values_v, np.float64)
        values = np.where(np.isfinite(values), values, np.nan)
        confirmed = self._confirmed(values)
        # where the signal rises through the middle: the sample after it, and its place between the two
        known = np.concatenate([[self._passage.last_v], values])
        below, above = known[:-1], known[1:]
        crossings = np.flatnonzero((below < self._middle_v) & (above >= self._middle_v))
        share = (self._middle_v - below[crossings]) / (above[crossings] - below[crossings])
        crossings = self._passage.count + crossings
        positions = crossings - 1 + share
        found = []
        for at, low in confirmed:
            latest = np.searchsorted(crossings, at, side="right") - 1
            position = positions[latest] if latest >= 0 else self._passage.crossing
            found.append(position if position >= low else float(at))
        if len(positions):
            self._passage.crossing = float(positions[-1])
        if len(values):
            self._passage.last_v = float(values[-1])
        self._passage.count += len(values)
        return Edges(np.array(found, np.float64), np.array([at for at, _ in confirmed], np.intp))

    def _confirmed(self, values: Array) -> list[tuple[int, int]]:
        """Samples at which an edge is certain, and the last low sample before each; from the start."""
        passage = self._passage
        decided = np.flatnonzero((values > self._high_v) | (values < self._low_v))
        found: list[tuple[int, int]] = []
        if not len(decided):
            return found
        high = values[decided] > self._high_v
        before = np.concatenate([[bool(passage.is_high) or passage.is_high is None], high[:-1]])
        for number in np.flatnonzero(high & ~before):
            low = passage.count + int(decided[number - 1]) if number else passage.last_low
            found.append((passage.count + int(decided[number]), low))
        passage.is_high = bool(high[-1])
        if not high.all():
            passage.last_low = passage.count + int(decided[np.flatnonzero(~high)[-1]])
        return found
