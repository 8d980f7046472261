"""How the peak forces scatter, measured and predicted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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

_HEADINGS = (
    "peak", "half cycles", "mean", "standard deviation", "smallest", "largest", "mean against measured",
)  # fmt: skip

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
    plots = Plots(rows=2, columns=2, row_px=_ROW_PX)
    rows = []
    for column, (name, peaks) in enumerate(kinds.items()):
        _draw(plots, column, name, peaks)
        measured = peaks.get("measured")
        for whose, values in peaks.items():
            deviation = float(np.std(values, ddof=1)) if len(values) > 1 else None
            numbers = (float(values.mean()), deviation, float(values.min()), float(values.max()))
            against = ""
            if measured is not None and whose != "measured":
                against = difference(numbers[0], float(measured.mean()))
            told = [number(each, "N") for each in numbers]
            rows.append([f"{name}, {whose}", str(len(values)), *told, against])
    return [
        Sentence(_EXPLANATION),
        Table(_HEADINGS, rows, "Peak force of each half cycle"),
        plots.figure("peaks"),
    ]


def _draw(plots: Plots, column: int, name: str, peaks: Peaks) -> None:
    """A histogram above the distribution function, both over one force axis."""
    upper, lower = column, column + 2
    plots.axes(upper, f"{name}: half cycles per bin", _FORCE, y_axis={"rangemode": "tozero"})
    title = f"{name}: share of half cycles up to this force"
    plots.axes(lower, title, _FORCE, y_axis={"range": [0, 1.02]}, share_x_with=upper)
    together = np.concatenate(list(peaks.values()))
    edges = np.histogram_bin_edges(together, bins=min(max(len(together) // 8, 5), _MOST_BINS))
    for whose, values in peaks.items():
        counts, _ = np.histogram(values, bins=edges)
        if whose == "measured" or len(peaks) < _CROWD:
            plots.bars(upper, whose, (edges[:-1] + edges[1:]) / 2, counts)
        else:
            outline = [0, *counts, 0]
            plots.line(upper, whose, [edges[0], *edges], outline, subject=f"peaks {name}", shape="hv")
        shares = np.arange(1, len(values) + 1) / len(values)
        plots.line(lower, whose, np.sort(values), shares, subject=f"peaks {name}", shape="hv")
