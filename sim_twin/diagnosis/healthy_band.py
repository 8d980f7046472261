"""Whether a run lies within what healthy rigs of its scenario do, and where it does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.gap import GapMeasure, gap_measure

Array = NDArray[np.float64]
_LEAST = 1e-3
_ALONE = 4.5
"""Deviations: the largest of hundreds of normal numbers lies nearer."""
_LEAST_SPREAD = 0.02
"""Of logarithms of gaps: few rigs may not pretend less."""


@dataclass(frozen=True, slots=True)
class Place:
    """How far a run lies off in all ("") or in one channel: 1 as far as a typical healthy rig lies.

    `farthest` of the healthy rigs that were simulated; `beyond` what any of them does anywhere. `worst` is
    the cell that lies farthest off.
    """

    channel: str
    gap: float
    farthest: float
    beyond: bool
    worst: Cell


@dataclass(frozen=True, slots=True)
class HealthyBand:
    """Gaps of `rigs` healthy rigs, each from the twin that the others make.

    `typical`, `spread` and `farthest`, shape (1 + channels,), are mean, deviation and largest of the
    logarithm of the gap over all cells and over those of each channel. `limits`, so too, are in deviations
    the most that any rig lies above the mean of the others anywhere, so that one healthy rig in so many lies
    beyond. A place where one rig is far from all others, such as a point that is hardly ever struck, has a
    limit of its own.
    """

    measure: GapMeasure
    typical: Array
    spread: Array
    farthest: Array
    limits: Array
    rigs: int

    def places(self, blocks: NDArray[np.floating]) -> list[Place]:
        """All of a run's fingerprints (blocks, numbers) first, then its channels, the farthest off first."""
        cells = self.measure.cells(blocks)
        off = np.log(_gaps(self.measure, cells)) - self.typical
        found = []
        for number, channel in enumerate(_places(self.measure.layout)):
            inside = [k for k, cell in enumerate(self.measure.layout.cells) if _belongs(cell, channel)]
            worst = self.measure.layout.cells[max(inside, key=lambda k: float(cells[k]))]
            beyond = bool(off[number] > self.limits[number] * self.spread[number])
            farthest = float(np.exp(self.farthest[number] - self.typical[number]))
            found.append(Place(channel, float(np.exp(off[number])), farthest, beyond, worst))
        whole, *channels = found
        order = np.argsort(-off[1:] / self.spread[1:], kind="stable")
        return [whole, *(channels[k] for k in order)]


def healthy_band(healthy: Sequence[NDArray[np.floating]], layout: Layout) -> HealthyBand:
    """The band of healthy rigs' fingerprints, each (blocks, numbers)."""
    gaps = []
    for number, blocks in enumerate(healthy):
        others = gap_measure([*healthy[:number], *healthy[number + 1 :]], layout)
        gaps.append(_gaps(others, others.cells(blocks)))
    logs = np.log(np.array(gaps))
    typical, spread = _normal(logs)
    above = np.max((logs - typical) / spread, axis=0)
    alike = above < _ALONE
    # as a run is held against all: by a mean and deviation that it is in itself, a rig lies nearer
    beside = np.max([_above(logs, number) for number in range(len(logs))], axis=0)
    limits = np.where(alike, beside[alike].max(initial=0.0), above)
    return HealthyBand(gap_measure(healthy, layout), typical, spread, logs.max(axis=0), limits, len(healthy))


def _normal(logs: Array) -> tuple[Array, Array]:
    return logs.mean(axis=0), np.maximum(logs.std(axis=0, ddof=1), _LEAST_SPREAD)


def _above(logs: Array, number: int) -> Array:
    """How many deviations one rig lies above the mean of the others."""
    mean, deviation = _normal(np.delete(logs, number, axis=0))
    return np.asarray((logs[number] - mean) / deviation)


def _places(layout: Layout) -> list[str]:
    return ["", *dict.fromkeys(cell.channel for cell in layout.cells)]


def _belongs(cell: Cell, channel: str) -> bool:
    return not channel or (cell.channel == channel and cell.partner is None)


def _gaps(measure: GapMeasure, cells: Array) -> Array:
    """In floors: the measure's unit is of all cells, and one rig in it would count in every channel."""
    totals = (
        measure.unit * measure.total(cells, lambda cell, channel=channel: _belongs(cell, channel))  # type: ignore[misc]
        for channel in _places(measure.layout)
    )
    return np.array([max(total, _LEAST) for total in totals])
