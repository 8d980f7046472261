"""Where the gap lies: over channels, bands, phases of the cycle and runs, before and after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rig.diagnosis.report.case import Array, Case, Span, cell_words, floors
from rig.pages.content import Bar, BarTable, Figure, Part, Sentence, Table
from rig.pages.plots import Plots
from rig.pages.words import probability
from sim_twin.diagnosis.fingerprint import Cell
from sim_twin.diagnosis.where import NOT_KNOWN

_ROW_PX, _FEWEST_PX = 26, 110
_LARGEST = 10
_BELOW_PX = 84
_WORTH_TELLING = 0.01
_HOW = "White is healthy, each colour twice the gap of the one before. Point at a cell to read it."
_Column = Callable[[Cell], Span | str | None]
_VIEWS: dict[str, tuple[str, _Column]] = {
    "spectrum": ("Hz", lambda cell: None if cell.partner else cell.band),
    "course over the cycle": ("part of the cycle", lambda cell: cell.phase),
    "coherence with others": ("Hz", lambda cell: cell.band if cell.partner else None),
    "figures": ("", lambda cell: None if cell.band or cell.phase else cell.what),
}


def parts(case: Case) -> list[Part]:
    """Shares of the places, a map for each run, and the largest cells."""
    states = {"before": case.cell_gaps(after=False)}
    if case.repaired:
        states["after"] = case.cell_gaps(after=True)
    names = {name: (lambda cell, name=name: cell.channel == name) for name in case.channels}
    caption, several = "Gap of each channel", len(case.run_numbers) > 1
    if several:
        names |= {case.run_name(k): (lambda cell, k=k: cell.run == k) for k in case.run_numbers}
        caption += " and run"
    rows = [
        [name, *(floors(case.gap_of(chosen, state == "after")) for state in states)]
        for name, chosen in names.items()
    ]
    # of each kind the largest: that is what lies farthest, not one band beside the other
    kinds: dict[tuple[int, str, str | None, str], int] = {}
    for k in np.argsort(-states["before"], kind="stable"):
        cell = case.cells[k]
        kinds.setdefault((cell.run, cell.channel, cell.partner, cell.what), k)
    largest = [
        [
            cell_words(case.cells[k]),
            *([case.run_name(case.cells[k].run)] if several else []),
            case.cell_words_of(k, case.findings.measured),
            case.cell_words_of(k, case.findings.nominal),
            *(case.cell_gap_words(k, state == "after") for state in states),
        ]
        for k in list(kinds.values())[:_LARGEST]
    ]
    headings = ["cell", *(["run"] if several else []), "measured", "nominal twin", *states]
    return [
        Sentence(_HOW),
        *(_map(case, run, states) for run in case.run_numbers),
        *_places(case),
        Table(["channel", *states], rows, caption),
        Table(headings, largest, f"The {len(largest)} largest gaps, of each quantity where it is largest"),
    ]


def _places(case: Case) -> list[Part]:
    shares = sorted(case.findings.by_location.items(), key=lambda each: -each[1])
    if not shares or case.findings.verdict == "none":
        return [Sentence("No place has a share: nothing is believed to be missing.")]
    rows = [
        Bar(location, share, probability(share), apart=location == NOT_KNOWN)
        for location, share in shares
        if share >= _WORTH_TELLING
    ]
    rest = 1 - sum(row.share for row in rows)
    rows += [Bar("elsewhere", rest, probability(rest), apart=True)] if len(rows) < len(shares) else []
    table = BarTable(("location", "share"), rows, "Share of the gap that comes from a place")
    off = case.findings.alone_off
    if not off or case.findings.verdict != "unknown":
        return [table]
    return [Sentence(f"{off} alone does not fit: look at its sensor, its cable, and what it sits on."), table]


def _map(case: Case, run: int, states: Mapping[str, Array]) -> Figure:
    names = case.channels[::-1]
    at = [k for k, cell in enumerate(case.cells) if cell.run == run]
    cells = [case.cells[k] for k in at]
    views = {
        title: view for title, view in _VIEWS.items() if any(view[1](cell) is not None for cell in cells)
    }
    plots = Plots(len(states), len(views), max(_FEWEST_PX, _ROW_PX * len(names)), legend=True)
    for row, (state, values) in enumerate(states.items()):
        for column, (title, (unit, columns)) in enumerate(views.items()):
            cell, last = row * len(views) + column, row == len(states) - 1
            labels, found = grid_of(cells, values[at], names, columns)
            spans = [label for label in labels if not isinstance(label, str)]
            edges: list[Any] = [*(low for low, _ in spans), spans[-1][1]] if spans else list(labels)
            log = {"type": "log", "dtick": 1} if unit == "Hz" else {}
            plots.axes(
                cell,
                f"{state}: {title}" if column == 0 else title,
                unit if last else "",
                x_axis={"showgrid": False, "showticklabels": last, "tickangle": 0 if unit else 90, **log},
                y_axis={"showgrid": False, "showticklabels": column == 0, "ticks": ""},
            )
            plots.heat(cell, edges, names, found)
    return plots.figure(f"map-{run}", case.run_name(run), _BELOW_PX)


def grid_of(
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
