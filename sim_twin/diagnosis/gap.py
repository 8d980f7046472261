"""How far a measurement lies from a twin, in units of a healthy rig's own distance from it.

The distance of two distributions is the first Wasserstein distance, by the means of their fifths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.fingerprint import Cell, Layout

Array = NDArray[np.float64]
FARTHEST = 40.0
"""In floors; one cell says no more than that."""
_SAME_BAND = 0.005
"""Of its ends."""
_LEAST_UNIT = 0.5
"""Of a floor; a healthy rig lies about one floor away, and few draws may not pretend less."""


@dataclass(frozen=True, slots=True)
class GapMeasure:
    """Made of healthy rigs' fingerprints; `floor` is a healthy block's distance from the twin."""

    layout: Layout
    twin: Array
    floor: Array
    unit: float

    def cells(self, blocks: NDArray[np.floating]) -> Array:
        """Root mean square over blocks (n, numbers) of their distances from the twin, in floors, (cells,)."""
        apart = _by_cell(np.abs(np.asarray(blocks, dtype=np.float64) - self.twin), self.layout)
        return np.asarray(np.sqrt(np.mean(np.minimum(apart / self.floor, FARTHEST) ** 2, axis=0)))

    def of_repaired(self, rigs: Array) -> GapMeasure:
        """The same measure from a repaired twin, of which `rigs` (n, numbers) are healthy draws.

        Where they scatter more than nominal ones, their scatter is the floor: a channel that was quiet
        without the effect is not with it.
        """
        others = len(rigs) / max(1, len(rigs) - 1)
        apart = others * _by_cell(np.abs(rigs - rigs.mean(axis=0)), self.layout)
        floor = np.maximum(self.floor, apart.mean(axis=0))
        unit = float(np.sqrt(np.mean(np.minimum(apart / floor, FARTHEST) ** 2)))
        return GapMeasure(self.layout, rigs.mean(axis=0), floor, max(unit, _LEAST_UNIT))

    def total(self, cells: Array, chosen: Callable[[Cell], bool] = lambda _: True) -> float:
        """Root mean square over the chosen cells, 1 for a healthy rig."""
        kept = np.array([chosen(cell) for cell in self.layout.cells])
        return float(np.sqrt(np.mean(cells[kept] ** 2))) / self.unit if kept.any() else 0.0

    def of_channels(self, each: NDArray[np.floating]) -> dict[str, Array]:
        """Gap of each channel by itself, of each of some fingerprints (n, numbers), (n,)."""
        apart = _by_cell(np.abs(np.asarray(each, dtype=np.float64) - self.twin), self.layout) / self.floor
        squares = np.minimum(apart, FARTHEST) ** 2
        owners = np.array([cell.channel if cell.partner is None else "" for cell in self.layout.cells])
        names = [name for name in dict.fromkeys(owners.tolist()) if name]
        return {name: np.sqrt(squares[:, owners == name].mean(axis=1)) / self.unit for name in names}

    def of_runs(self, blocks: NDArray[np.floating]) -> list[float]:
        """Gap of each run's cells by themselves, of blocks (n, numbers)."""
        cells, runs = self.cells(blocks), sorted({cell.run for cell in self.layout.cells})
        return [self.total(cells, lambda cell, run=run: cell.run == run) for run in runs]  # type: ignore[misc]

    def apart(self, blocks: NDArray[np.floating], one: int, other: int) -> dict[str, float]:
        """How far run `one` of a rig lies from run `other`, less what the twin's runs differ by, in floors.

        By what is looked at in both: of each channel, or two, and figure, in words, rms over its cells.
        """
        pairs = _alike(self.layout, one, other)
        if not pairs:
            return {}
        starts = self.layout.starts
        mine, theirs = (
            np.concatenate([np.arange(starts[pair[k]], starts[pair[k] + 1]) for pair in pairs])
            for k in (0, 1)
        )
        off, moved = np.mean(blocks, axis=0, dtype=np.float64) - self.twin, self.twin.copy()
        moved[mine] += off[mine] - off[theirs]
        cells = self.cells(moved[None])
        squares: dict[str, list[float]] = {}
        for at, _ in pairs:
            cell = self.layout.cells[at]
            beside = "" if cell.partner is None else f" with {cell.partner}"
            squares.setdefault(f"{cell.what} of {cell.channel}{beside}", []).append(float(cells[at]) ** 2)
        return {what: float(np.sqrt(np.mean(each))) for what, each in squares.items()}

    def course(self, blocks: NDArray[np.floating]) -> list[list[float]]:
        """Gap of each run's cells in each of its blocks (n, numbers), (runs, n)."""
        of_blocks = [self.of_runs(block[None]) for block in blocks]
        return [list(each) for each in zip(*of_blocks, strict=True)]


@lru_cache(maxsize=64)
def _alike(layout: Layout, one: int, other: int) -> tuple[tuple[int, int], ...]:
    """Cells of two runs in which the same is looked at, by their positions.

    Bands hang on the frequency that was measured, and may be others where it was a little off.
    """
    theirs: dict[tuple[object, ...], list[int]] = {}
    for at, cell in enumerate(layout.cells):
        if cell.run == other:
            theirs.setdefault(_kind(cell), []).append(at)
    found = []
    for at, cell in enumerate(layout.cells):
        if cell.run == one:
            left = theirs.get(_kind(cell), [])
            same = next((k for k in left if _same_band(cell.band, layout.cells[k].band)), None)
            if same is not None:
                left.remove(same)
                found.append((at, same))
    return tuple(found)


def _kind(cell: Cell) -> tuple[object, ...]:
    phase = None if cell.phase is None else tuple(round(share, 6) for share in cell.phase)
    return cell.channel, cell.partner, cell.what, cell.size, phase


def _same_band(one: tuple[float, float] | None, other: tuple[float, float] | None) -> bool:
    if one is None or other is None:
        return one is other
    return all(abs(low / high - 1) < _SAME_BAND for low, high in zip(one, other, strict=True))


def _by_cell(apart: Array, layout: Layout) -> Array:
    """Mean over the numbers of each cell, from shape (n, numbers) to (n, cells)."""
    return np.asarray(np.add.reduceat(apart, layout.starts[:-1], axis=1) / np.diff(layout.starts))


def gap_measure(healthy: Sequence[NDArray[np.floating]], layout: Layout) -> GapMeasure:
    """Measure by healthy rigs' fingerprints, each (blocks, numbers)."""
    blocks = np.concatenate(healthy).astype(np.float64)
    twin = blocks.mean(axis=0)
    apart = _by_cell(np.abs(blocks - twin), layout)
    tolerance = np.array([cell.tolerance for cell in layout.cells])
    floor = np.hypot(apart.mean(axis=0), tolerance)
    floor[floor < 1e-9] = np.inf
    plain = GapMeasure(layout, twin, floor, 1.0)
    return GapMeasure(layout, twin, floor, plain.total(plain.cells(blocks)))


def shrink_of(before: float, after: float) -> float | None:
    """Share of the gap that is gone; None where there is none."""
    return None if before <= 1.0 else 1 - max(after - 1.0, 0.0) / (before - 1.0)
