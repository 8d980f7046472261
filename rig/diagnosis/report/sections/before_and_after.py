"""Measured, nominal and repaired twin in the channels with the largest gaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import log

import numpy as np

from rig.diagnosis.report import gaps
from rig.diagnosis.report.content import Part
from rig.diagnosis.report.plots import Plots
from rig.diagnosis.report.reported import Array, Reported
from rig.diagnosis.report.words import floors, listed, unit_words
from rig.report.content import Sentence
from sim_twin.diagnosis.fingerprint.layout import SLICES, Cell

_SHOWN = 3
_ROW_PX = 210
_DECIBELS = 10 / log(10)
_CAPTION = (
    "Means over the cycles. Spectra: energy in bands, against the loudest measured band. Peaks: the "
    "largest values of the cycles, from the fifth of the cycles with the weakest to that with the strongest."
)
_BAND = " Grey: how far a healthy rig usually lies from the nominal twin."
_TITLES = ("spectrum", "course over the cycle", "peaks")


def parts(reported: Reported) -> list[Part]:
    """A row of plots for each channel: spectrum, course over the cycle, peaks."""
    largest = gaps.largest_channels(reported)
    shown = [(name, run) for name, run, _ in largest if _cells(reported, name, run, "energy")][:_SHOWN]
    if not shown:
        return [
            Sentence("These fingerprints hold no spectra; the table of the largest gaps says what differs.")
        ]
    plots = Plots(len(shown), len(_TITLES), _ROW_PX)
    for row, (name, run) in enumerate(shown):
        _spectrum(plots, len(_TITLES) * row, reported, name, run)
        _course(plots, len(_TITLES) * row + 1, reported, name, run)
        _peaks(plots, len(_TITLES) * row + 2, reported, name, run)
    told = listed([_told(reported, name, run) for name, run in shown])
    band = _BAND
    return [Sentence(f"The largest gaps: {told}."), plots.figure("before-and-after", _CAPTION + band)]


def _told(reported: Reported, channel: str, run: int) -> str:
    states = {"before": False, "after": True} if reported.repaired else {"before": False}
    sizes = [
        f"{floors(gaps.gap_of(reported, gaps.within(channel, run), after))} {state}"
        for state, after in states.items()
    ]
    where = f" in {reported.run_name(run)}" if len(gaps.runs(reported)) > 1 else ""
    return f"{channel}{where} ({', '.join(sizes)})"


def _cells(reported: Reported, channel: str, run: int, what: str) -> list[int]:
    return [
        k
        for k, cell in enumerate(reported.findings.layout.cells)
        if (cell.channel, cell.run, cell.what, cell.partner) == (channel, run, what, None)
    ]


def _spectrum(plots: Plots, cell: int, reported: Reported, channel: str, run: int) -> None:
    at = _cells(reported, channel, run, "energy")
    bands = _edges([reported.findings.layout.cells[k] for k in at])
    loudest = max(_means(reported, reported.findings.measured, at))
    x = {"type": "log", "dtick": 1, "title": {"text": "frequency, Hz"}}
    plots.axes(cell, f"{channel}: spectrum", x, {"title": {"text": "level, dB"}})
    _draw(plots, cell, reported, at, bands, lambda values: _DECIBELS * (values - loudest))


def _course(plots: Plots, cell: int, reported: Reported, channel: str, run: int) -> None:
    at = _cells(reported, channel, run, "rms")
    phases = _edges([reported.findings.layout.cells[k] for k in at])
    unit = reported.unit(run, channel)
    x = {"title": {"text": "part of the cycle"}, "range": [0, 1]}
    plots.axes(
        cell, "rms over the cycle", x, {"title": {"text": f"rms, {unit_words(unit)}"}, "rangemode": "tozero"}
    )
    _draw(plots, cell, reported, at, phases, lambda values: np.exp(values / 2))


def _peaks(plots: Plots, cell: int, reported: Reported, channel: str, run: int) -> None:
    at = _cells(reported, channel, run, "peak")
    unit = reported.unit(run, channel)
    x = {"tickvals": list(range(SLICES)), "ticktext": ["weakest", "", "middle", "", "strongest"]}
    x |= {"title": {"text": "fifth of the cycles"}}
    plots.axes(cell, "peaks", x, {"title": {"text": f"peak, {unit_words(unit)}"}, "rangemode": "tozero"})
    if not at:
        return
    fifths = np.arange(SLICES, dtype=np.float64)
    values = _lines(reported, lambda numbers: _slices(reported, numbers, at[0]))
    floor = reported.findings.floor[at[0]]
    low, high = (values["nominal twin"] + sign * floor for sign in (-1, 1))
    plots.band(cell, fifths, np.exp(low), np.exp(high), "linear")
    for whose, logarithms in values.items():
        plots.line(cell, whose, fifths, np.exp(logarithms), "linear", markers=True)


def _draw(
    plots: Plots, cell: int, reported: Reported, at: list[int], edges: Array, shown: Callable[[Array], Array]
) -> None:
    """Steps over `edges`, of cells' means as `shown`."""
    if not at:
        return
    values = _lines(reported, lambda numbers: _means(reported, numbers, at))
    floor = reported.findings.floor[at]
    low, high = (shown(values["nominal twin"] + sign * floor) for sign in (-1, 1))
    plots.band(cell, edges, _to_the_end(low), _to_the_end(high), "hv")
    for whose, means in values.items():
        plots.line(cell, whose, edges, _to_the_end(shown(means)), "hv")


def _lines(reported: Reported, of: Callable[[Array], Array]) -> dict[str, Array]:
    found = reported.findings
    lines = {"measured": of(found.measured), "nominal twin": of(found.nominal)}
    return lines if found.repaired is None else lines | {"repaired twin": of(found.repaired)}


def _slices(reported: Reported, numbers: Array, cell: int) -> Array:
    starts = reported.findings.layout.starts
    return numbers[starts[cell] : starts[cell + 1]]


def _means(reported: Reported, numbers: Array, at: list[int]) -> Array:
    return np.array([_slices(reported, numbers, cell).mean() for cell in at])


def _edges(cells: Sequence[Cell]) -> Array:
    spans = [cell.band or cell.phase or (0.0, 1.0) for cell in cells]
    return np.array([*(low for low, _ in spans), *(high for _, high in spans[-1:])])


def _to_the_end(values: Array) -> Array:
    return np.append(values, values[-1])
