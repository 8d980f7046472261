"""Where the gap lies: over channels, bands, phases of the cycle and runs, before and after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rig.diagnosis.report import gaps
from rig.diagnosis.report.content import Bar, BarTable, Part
from rig.diagnosis.report.plots import Plots
from rig.diagnosis.report.reported import Array, Reported
from rig.diagnosis.report.words import cell_words, floors, percent
from rig.report.content import Figure, Sentence, Table
from sim_twin.diagnosis.fingerprint.layout import Cell

_ROW_PX, _FEWEST_PX = 26, 110
_LARGEST = 10
_BELOW_PX = 84
_WORTH_TELLING = 0.01
_HOW = "White is healthy, each colour twice the gap of the one before. Point at a cell to read it."
_Column = Callable[[Cell], gaps.Span | str | None]
_VIEWS: dict[str, tuple[str, _Column]] = {
    "spectrum": ("Hz", lambda cell: None if cell.partner else cell.band),
    "course over the cycle": ("part of the cycle", lambda cell: cell.phase),
    "coherence with others": ("Hz", lambda cell: cell.band if cell.partner else None),
    "whole cycles": ("", lambda cell: None if cell.band or cell.phase else cell.what),
}


def parts(reported: Reported) -> list[Part]:
    """Shares of the places, a map for each run, and the largest cells."""
    maps: list[Part] = [_map(reported, run) for run in gaps.runs(reported)]
    return [Sentence(_HOW), *maps, *_places(reported), _of_channels(reported), _largest(reported)]


def _places(reported: Reported) -> list[Part]:
    shares = sorted(reported.findings.by_location.items(), key=lambda each: -each[1])
    if not shares or reported.verdict == "none":
        return [Sentence("No place has a share: nothing is believed to be missing.")]
    rows = [Bar(location, share, percent(share)) for location, share in shares if share >= _WORTH_TELLING]
    rest = 1 - sum(row.share for row in rows)
    rows += [Bar("elsewhere", rest, percent(rest), apart=True)] if len(rows) < len(shares) else []
    return [BarTable(("location", "share"), rows, "Share of the gap that effects at a place explain")]


def _of_channels(reported: Reported) -> Table:
    headings = ["channel", "before", *(["after"] if reported.repaired else [])]
    names = {name: (lambda cell, name=name: cell.channel == name) for name in gaps.channels(reported)}
    numbers = gaps.runs(reported)
    if len(numbers) > 1:
        names |= {reported.run_name(k): (lambda cell, k=k: cell.run == k) for k in numbers}
    rows = []
    for name, chosen in names.items():
        states = (False, True) if reported.repaired else (False,)
        rows.append([name, *(floors(gaps.gap_of(reported, chosen, after)) for after in states)])
    return Table(headings, rows, "Gap of each channel" + (" and run" if len(numbers) > 1 else ""))


def _map(reported: Reported, run: int) -> Figure:
    names = gaps.channels(reported)[::-1]
    gap = reported.findings.gap
    states = {"before": gap.cells_before / gap.unit_before}
    if reported.repaired:
        states["after"] = gap.cells_after / gap.unit_after
    at = [k for k, cell in enumerate(reported.findings.layout.cells) if cell.run == run]
    cells = [reported.findings.layout.cells[k] for k in at]
    views = {
        title: view for title, view in _VIEWS.items() if any(view[1](cell) is not None for cell in cells)
    }
    plots = Plots(len(states), len(views), max(_FEWEST_PX, _ROW_PX * len(names)))
    for row, (state, values) in enumerate(states.items()):
        for column, (title, (unit, columns)) in enumerate(views.items()):
            labels, found = gaps.grid(cells, values[at], names, columns)
            shown = _Shown(
                f"{state}: {title}" if column == 0 else title, unit, column == 0, row == len(states) - 1
            )
            _draw(plots, row * len(views) + column, shown, names, labels, found)
    return plots.figure(f"map-{run}", reported.run_name(run), _BELOW_PX)


@dataclass(frozen=True, slots=True)
class _Shown:
    """What is written around a plot."""

    title: str
    unit: str
    rows: bool
    columns: bool


def _draw(
    plots: Plots, cell: int, shown: _Shown, names: list[str], labels: list[gaps.Span | str], found: Array
) -> None:
    x: dict[str, Any] = {
        "showgrid": False,
        "showticklabels": shown.columns,
        "tickangle": 0 if shown.unit else 90,
    }
    x |= {"title": {"text": shown.unit if shown.columns else ""}}
    spans = [label for label in labels if not isinstance(label, str)]
    edges: list[Any] = [*(low for low, _ in spans), spans[-1][1]] if spans else list(labels)
    if shown.unit == "Hz":
        x |= {"type": "log", "dtick": 1}
    plots.axes(cell, shown.title, x, {"showgrid": False, "showticklabels": shown.rows, "ticks": ""})
    plots.heat(cell, edges, names, found)


def _largest(reported: Reported) -> Table:
    several, repaired = len(gaps.runs(reported)) > 1, reported.repaired
    rows = [
        [
            cell_words(cell),
            *([reported.run_name(cell.run)] if several else []),
            floors(before),
            *([floors(after)] if repaired else []),
        ]
        for cell, before, after in gaps.largest_cells(reported, _LARGEST)
    ]
    headings = ["cell", *(["run"] if several else []), "before", *(["after"] if repaired else [])]
    return Table(headings, rows, f"The {len(rows)} largest gaps")
