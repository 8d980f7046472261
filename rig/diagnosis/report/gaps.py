"""Gaps of groups of cells: by channel, run, band and phase."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.diagnosis.report.reported import Reported
from sim_twin.diagnosis.fingerprint.layout import Cell

Array = NDArray[np.float64]
Span = tuple[float, float]
_ALIKE = 0.7
"""Share of the largest gap from which on its neighbours are named with it."""


def gap_of(reported: Reported, chosen: Callable[[Cell], bool], after: bool = False) -> float:
    """Gap of the chosen cells, 1 for a healthy rig; NaN where there are none."""
    gap = reported.findings.gap
    cells, unit = (gap.cells_after, gap.unit_after) if after else (gap.cells_before, gap.unit_before)
    kept = [value for cell, value in zip(reported.findings.layout.cells, cells, strict=True) if chosen(cell)]
    return float(np.sqrt(np.mean(np.square(kept)))) / unit if kept else float("nan")


def channels(reported: Reported) -> list[str]:
    """Channels in the fingerprint, in its order."""
    return list(dict.fromkeys(cell.channel for cell in reported.findings.layout.cells))


def runs(reported: Reported) -> list[int]:
    """Numbers of the runs in the fingerprint."""
    return sorted({cell.run for cell in reported.findings.layout.cells})


def largest_channels(reported: Reported) -> list[tuple[str, int, float]]:
    """Channels, largest gap first, each with the run in which it is largest, and the gap there."""
    found = [
        max(
            ((name, run, gap_of(reported, within(name, run))) for run in runs(reported)),
            key=lambda each: each[2],
        )
        for name in channels(reported)
    ]
    return sorted(found, key=lambda each: -each[2])


def largest_span(
    reported: Reported, channel: str, run: int, spans: Callable[[Cell], Span | None]
) -> Span | None:
    """Where a channel's gap is largest over its bands or phases (`spans` tells which), and its like around.

    None where it is much the same everywhere, or where there are no spans.
    """
    sizes: dict[Span, float] = {}
    cells = zip(reported.findings.layout.cells, reported.findings.gap.cells_before, strict=True)
    for cell, value in cells:
        here = spans(cell)
        if here and within(channel, run)(cell) and not cell.partner:
            sizes[here] = max(float(value), sizes.get(here, 0.0))
    order = sorted(sizes)
    if not order:
        return None
    high = [sizes[here] >= _ALIKE * max(sizes.values()) for here in order]
    first = last = order.index(max(order, key=lambda here: sizes[here]))
    while first > 0 and high[first - 1]:
        first -= 1
    while last + 1 < len(order) and high[last + 1]:
        last += 1
    return None if (first, last) == (0, len(order) - 1) else (order[first][0], order[last][1])


def largest_cells(reported: Reported, count: int) -> list[tuple[Cell, float, float]]:
    """The cells with the largest gaps, with the gap before and after."""
    gap = reported.findings.gap
    order = np.argsort(-gap.cells_before)[:count]
    cells = reported.findings.layout.cells
    before, after = gap.cells_before / gap.unit_before, gap.cells_after / gap.unit_after
    return [(cells[k], before[k], after[k]) for k in order]


def grid(
    cells: Sequence[Cell], values: Array, rows: Sequence[str], columns: Callable[[Cell], Span | str | None]
) -> tuple[list[Span | str], Array]:
    """Root mean squares of cells by channel and column, shape (rows, columns); NaN where there is no cell.

    A cell of two channels counts for both; one that `columns` gives nothing for counts for none.
    """
    labels = list(dict.fromkeys(label for cell in cells if (label := columns(cell)) is not None))
    sums, counts = np.zeros((len(rows), len(labels))), np.zeros((len(rows), len(labels)))
    for cell, value in zip(cells, values, strict=True):
        label = columns(cell)
        for name in {cell.channel, cell.partner} & set(rows) if label is not None else ():
            at = rows.index(name or ""), labels.index(label or "")
            sums[at] += value**2
            counts[at] += 1
    with np.errstate(invalid="ignore"):
        return labels, np.sqrt(sums / counts)


def within(channel: str, run: int) -> Callable[[Cell], bool]:
    """Chooses the cells of a channel in a run."""
    return lambda cell: cell.channel == channel and cell.run == run
