"""How the peak forces scatter, measured and predicted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.signals import HalfCycles
from rig.pages.content import Part, Sentence, Table
from rig.pages.plots import Plots
from rig.pages.words import difference, number
from rig.report.record import ORIGINS, RunRecord
from rig.report.summary import half_cycles_of

_ROW_PX = 230
_MOST_BINS = 40
_CROWD = 3
"""So many histograms hide each other: then only the measured one is filled."""
_FORCE = "peak force, N"
_EXPLANATION = (
    "A half cycle is all contact on one side before any on the other; a contact counts once its force passes "
    "a tenth of the largest in the run. 'First' is the peak of its first contact, 'max' its largest force."
)

Peaks = dict[str, NDArray[np.float64]]


def parts(run: RunRecord) -> list[Part]:
    """Histogram and distribution function of *first* and of *max*, and their numbers.

    Nothing for a rig that has no such pair of stops.
    """
    if run.roles.stops is None:
        return []
    found = {run.whose(origin): half_cycles_of(run, origin) for origin in ORIGINS}
    if all(cycles is None for cycles in found.values()):
        return [Sentence("This run has no pair of contact forces, so there are no half cycles to count.")]
    cycles = {whose: each for whose, each in found.items() if each is not None and len(each)}
    if not cycles:
        return [Sentence("No impact in this run: the contact forces stay below 0.5 N.")]
    kinds: dict[str, Peaks] = {
        "first": {whose: each.first_n for whose, each in cycles.items()},
        "max": {whose: each.max_n for whose, each in cycles.items()},
    }
    grid = Plots(rows=2, columns=2, row_px=_ROW_PX)
    for column, (name, peaks) in enumerate(kinds.items()):
        _histogram(grid, column, name, peaks)
        _distribution(grid, 2 + column, name, peaks, share_x_with=column)
    return [Sentence(_EXPLANATION), _table(kinds, cycles), grid.figure("peaks")]


def _histogram(grid: Plots, cell: int, name: str, peaks: Peaks) -> None:
    grid.axes(cell, f"{name}: half cycles per bin", _FORCE, y_axis={"rangemode": "tozero"})
    together = np.concatenate(list(peaks.values()))
    edges = np.histogram_bin_edges(together, bins=min(max(len(together) // 8, 5), _MOST_BINS))
    for whose, values in peaks.items():
        counts, _ = np.histogram(values, bins=edges)
        if whose == "measured" or len(peaks) < _CROWD:
            grid.bars(cell, whose, (edges[:-1] + edges[1:]) / 2, counts.astype(np.float64))
        else:
            outline = np.concatenate(([0], counts, [0])).astype(np.float64)
            grid.line(cell, whose, np.append(edges[0], edges), outline, subject=f"peaks {name}", shape="hv")


def _distribution(grid: Plots, cell: int, name: str, peaks: Peaks, share_x_with: int) -> None:
    title = f"{name}: share of half cycles up to this force"
    grid.axes(cell, title, _FORCE, y_axis={"range": [0, 1.02]}, share_x_with=share_x_with)
    for whose, values in peaks.items():
        ordered = np.sort(values)
        shares = np.arange(1, len(ordered) + 1) / len(ordered)
        grid.line(cell, whose, ordered, shares, subject=f"peaks {name}", shape="hv")


def _table(kinds: dict[str, Peaks], cycles: dict[str, HalfCycles]) -> Table:
    rows = []
    for name, peaks in kinds.items():
        for whose, values in peaks.items():
            deviation = float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
            against = None if whose == "measured" else peaks.get("measured")
            rows.append(
                [
                    f"{name}, {whose}",
                    str(len(cycles[whose])),
                    number(float(values.mean()), "N"),
                    number(deviation, "N"),
                    number(float(values.min()), "N"),
                    number(float(values.max()), "N"),
                    "" if against is None else difference(float(values.mean()), float(against.mean())),
                ]
            )
    headings = (
        "peak",
        "half cycles",
        "mean",
        "standard deviation",
        "smallest",
        "largest",
        "mean against measured",
    )
    return Table(headings, rows, "Peak force of each half cycle")
