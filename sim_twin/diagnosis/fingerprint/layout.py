"""What the numbers of a fingerprint stand for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SLICES = 5
"""A cell that is a distribution is kept as the means of its lowest to its highest fifth of values."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One thing that is compared: of `channel` (of both, for a coherence), in `run`.

    `band` in Hz or `phase` in fractions of a cycle say where it lies; neither: a figure of the whole cycle,
    `what` it is. `size` numbers stand for it: a distribution's `SLICES`, or 1.
    """

    run: int
    channel: str
    what: str
    size: int = SLICES
    band: tuple[float, float] | None = None
    phase: tuple[float, float] | None = None
    partner: str | None = None


@dataclass(frozen=True, slots=True)
class Layout:
    """The cells of a fingerprint, in the order of its numbers."""

    cells: tuple[Cell, ...]

    @property
    def starts(self) -> NDArray[np.intp]:
        """Where each cell's numbers begin, and where the last ends; shape (cells + 1,)."""
        return np.concatenate([[0], np.cumsum([cell.size for cell in self.cells])]).astype(np.intp)

    @property
    def size(self) -> int:
        """How many numbers a fingerprint has."""
        return int(self.starts[-1])


def joined(layouts: tuple[Layout, ...]) -> Layout:
    """The layout of several runs, one after the other."""
    return Layout(tuple(cell for layout in layouts for cell in layout.cells))
