"""How far a measurement lies from a twin, in units of a healthy rig's own distance from it.

The distance of two distributions is the first Wasserstein distance, by the means of their fifths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.fingerprint.layout import Cell, Layout
from sim_twin.diagnosis.space import TOLERANCE

Array = NDArray[np.float64]
_FARTHEST = 40.0
"""In floors; one cell says no more than that."""


@dataclass(frozen=True, slots=True)
class GapMeasure:
    """Made of healthy rigs' fingerprints; `floor` is a healthy block's distance from the twin."""

    layout: Layout
    twin: Array
    floor: Array
    unit: float

    def cells(self, blocks: NDArray[np.floating], twin: Array | None = None) -> Array:
        """Distances of blocks (n, numbers) from a twin's mean fingerprint, in floors, shape (cells,)."""
        return np.asarray(self._each(blocks, self.twin if twin is None else twin).mean(axis=0))

    def _each(self, blocks: NDArray[np.floating], twin: Array) -> Array:
        apart = np.abs(np.asarray(blocks, dtype=np.float64) - twin)
        sums = np.add.reduceat(apart, self.layout.starts[:-1], axis=1)
        return np.asarray(np.minimum(sums / np.diff(self.layout.starts) / self.floor, _FARTHEST))

    def total(self, cells: Array, chosen: Callable[[Cell], bool] = lambda _: True) -> float:
        """Root mean square over the chosen cells, 1 for a healthy rig."""
        kept = np.array([chosen(cell) for cell in self.layout.cells])
        return float(np.sqrt(np.mean(cells[kept] ** 2))) / self.unit if kept.any() else 0.0


def gap_measure(healthy: Sequence[NDArray[np.floating]], layout: Layout) -> GapMeasure:
    """Measure by healthy rigs' fingerprints, each (blocks, numbers)."""
    blocks = np.concatenate(healthy).astype(np.float64)
    twin = blocks.mean(axis=0)
    apart = np.add.reduceat(np.abs(blocks - twin), layout.starts[:-1], axis=1) / np.diff(layout.starts)
    tolerance = np.array([TOLERANCE.get(cell.what, 0.0) for cell in layout.cells])
    floor = np.hypot(apart.mean(axis=0), tolerance)
    floor[floor < 1e-9] = np.inf
    plain = GapMeasure(layout, twin, floor, 1.0)
    unit = float(np.mean([plain.total(plain.cells(each)) for each in healthy]))
    return GapMeasure(layout, twin, floor, unit)


def shrink_of(before: float, after: float) -> float | None:
    """Share of the gap that is gone; None where there is none."""
    return None if before <= 1.0 else 1 - max(after - 1.0, 0.0) / (before - 1.0)
