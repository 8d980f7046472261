"""Measured, nominal and repaired twin in the channels with the largest gaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import log

import numpy as np

from rig.diagnosis.report.case import Array, Case, within
from rig.diagnosis.report.words import floors, unit_words
from rig.pages.content import Part, Sentence
from rig.pages.plots import BLACK, BLUE, ORANGE, Plots, Style
from rig.pages.words import listed
from sim_twin.diagnosis.fingerprint.layout import SLICES, Cell

_SHOWN = 3
_ROW_PX = 210
_DECIBELS = 10 / log(10)
_CAPTION = (
    "Means over the cycles. Spectra: energy in bands, against the loudest measured band. Peaks: the "
    "largest values of the cycles, from the fifth of the cycles with the weakest to that with the strongest. "
    "Grey: how far a healthy rig usually lies from the nominal twin."
)
LINES = {
    "measured": Style(BLUE, 3.2),
    "nominal twin": Style(ORANGE, 2.0, dash="4px,2px"),
    "repaired twin": Style(BLACK, 1.3),
}
"""Measured lies below and thick, so that it shows on both sides of a twin that meets it."""
_TITLES = ("spectrum", "course over the cycle", "peaks")


def parts(case: Case) -> list[Part]:
    """A row of plots for each channel: spectrum, course over the cycle, peaks."""
    largest = case.largest_channels()
    shown = [(name, run) for name, run, _ in largest if _cells(case, name, run, "energy")][:_SHOWN]
    if not shown:
        return [
            Sentence("These fingerprints hold no spectra; the table of the largest gaps says what differs.")
        ]
    plots = Plots(len(shown), len(_TITLES), _ROW_PX, legend=True)
    for row, (name, run) in enumerate(shown):
        _spectrum(plots, len(_TITLES) * row, case, name, run)
        _course(plots, len(_TITLES) * row + 1, case, name, run)
        _peaks(plots, len(_TITLES) * row + 2, case, name, run)
    told = []
    for name, run in shown:
        sizes = f"{floors(case.gap_of(within(name, run)))} before"
        if case.repaired:
            sizes += f", {floors(case.gap_of(within(name, run), after=True))} after"
        where = f" in {case.run_name(run)}" if len(case.run_numbers) > 1 else ""
        told.append(f"{name}{where} ({sizes})")
    return [Sentence(f"The largest gaps: {listed(told)}."), plots.figure("before-and-after", _CAPTION)]


def _cells(case: Case, channel: str, run: int, what: str) -> list[int]:
    return [
        k
        for k, cell in enumerate(case.cells)
        if (cell.channel, cell.run, cell.what, cell.partner) == (channel, run, what, None)
    ]


def _spectrum(plots: Plots, cell: int, case: Case, channel: str, run: int) -> None:
    at = _cells(case, channel, run, "energy")
    bands = _edges([case.cells[k] for k in at])
    loudest = max(_means(case, case.findings.measured, at))
    decades = {"type": "log", "dtick": 1}
    plots.axes(cell, f"{channel}: spectrum", "frequency, Hz", "level, dB", x_axis=decades)
    _draw(plots, cell, case, at, bands, lambda values: _DECIBELS * (values - loudest))


def _course(plots: Plots, cell: int, case: Case, channel: str, run: int) -> None:
    at = _cells(case, channel, run, "rms")
    phases = _edges([case.cells[k] for k in at])
    rms = f"rms, {unit_words(case.unit(run, channel))}"
    x, y = {"range": [0, 1]}, {"rangemode": "tozero"}
    plots.axes(cell, "rms over the cycle", "part of the cycle", rms, x_axis=x, y_axis=y)
    _draw(plots, cell, case, at, phases, lambda values: np.exp(values / 2))


def _peaks(plots: Plots, cell: int, case: Case, channel: str, run: int) -> None:
    at = _cells(case, channel, run, "peak")
    peak = f"peak, {unit_words(case.unit(run, channel))}"
    x = {"tickvals": list(range(SLICES)), "ticktext": ["weakest", "", "middle", "", "strongest"]}
    plots.axes(cell, "peaks", "fifth of the cycles", peak, x_axis=x, y_axis={"rangemode": "tozero"})
    if not at:
        return
    fifths = np.arange(SLICES, dtype=np.float64)
    values = _lines(case, lambda numbers: _slices(case, numbers, at[0]))
    floor = case.findings.floor[at[0]]
    low, high = (values["nominal twin"] + sign * floor for sign in (-1, 1))
    plots.band(cell, fifths, np.exp(low), np.exp(high), "linear")
    for whose, logarithms in values.items():
        style = replace(LINES[whose], mode="lines+markers", size=5)
        plots.line(cell, whose, fifths, np.exp(logarithms), style)


def _draw(
    plots: Plots, cell: int, case: Case, at: list[int], edges: Array, shown: Callable[[Array], Array]
) -> None:
    """Steps over `edges`, of cells' means as `shown`."""
    if not at:
        return
    values = _lines(case, lambda numbers: _means(case, numbers, at))
    floor = case.findings.floor[at]
    low, high = (shown(values["nominal twin"] + sign * floor) for sign in (-1, 1))
    plots.band(cell, edges, _to_the_end(low), _to_the_end(high), "hv")
    for whose, means in values.items():
        plots.line(cell, whose, edges, _to_the_end(shown(means)), LINES[whose], shape="hv")


def _lines(case: Case, of: Callable[[Array], Array]) -> dict[str, Array]:
    found = case.findings
    lines = {"measured": of(found.measured), "nominal twin": of(found.nominal)}
    return lines if found.repaired is None else lines | {"repaired twin": of(found.repaired)}


def _slices(case: Case, numbers: Array, cell: int) -> Array:
    starts = case.findings.layout.starts
    return numbers[starts[cell] : starts[cell + 1]]


def _means(case: Case, numbers: Array, at: list[int]) -> Array:
    return np.array([_slices(case, numbers, cell).mean() for cell in at])


def _edges(cells: Sequence[Cell]) -> Array:
    spans = [cell.band or cell.phase or (0.0, 1.0) for cell in cells]
    return np.array([*(low for low, _ in spans), *(high for _, high in spans[-1:])])


def _to_the_end(values: Array) -> Array:
    return np.append(values, values[-1])
