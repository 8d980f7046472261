"""Measured, nominal and repaired twin where gaps are largest, and what the joints' forces lack."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import log

import numpy as np

from rig.diagnosis.report.case import Array, Case, floors, plain, unit_words, within
from rig.pages.content import Part, Sentence
from rig.pages.plots import BLACK, BLUE, FROM_ZERO, GREEN, ORANGE, Plots, Style
from rig.pages.words import estimate, listed
from sim_twin.diagnosis.fingerprint import SLICES, Cell
from sim_twin.diagnosis.latent_force import Curve

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
RUNNER_UP = Style(GREEN, 1.1, dash="6px,2px,1px,2px")
"""Measured lies below and thick, so that it shows on both sides of a twin that meets it."""
_TITLES = ("spectrum", "course over the cycle", "peaks")


def parts(case: Case) -> list[Part]:
    """A row of plots for each channel: spectrum, course over the cycle, peaks."""
    shown = case.drawn_channels()
    if not shown:
        return [
            Sentence("These fingerprints hold no spectra; the table of the largest gaps says what differs.")
        ]
    plots = Plots(len(shown), len(_TITLES), _ROW_PX, legend=True)
    for row, (name, run) in enumerate(shown):
        cell = len(_TITLES) * row
        _spectrum(plots, cell, case, name, run)
        at = _cells(case, name, run, "rms")
        phases = _edges([case.cells[k] for k in at])
        rms = f"rms, {unit_words(case.unit(run, name))}"
        whole = {"range": [0, 1]}
        plots.axes(cell + 1, "rms over the cycle", "part of the cycle", rms, x_axis=whole, y_axis=FROM_ZERO)
        _draw(plots, cell + 1, case, at, phases, lambda values: np.exp(values / 2))
        _peaks(plots, cell + 2, case, name, run)
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


def _peaks(plots: Plots, cell: int, case: Case, channel: str, run: int) -> None:
    at = _cells(case, channel, run, "peak")
    peak = f"peak, {unit_words(case.unit(run, channel))}"
    x = {"tickvals": list(range(SLICES)), "ticktext": ["weakest", "", "middle", "", "strongest"]}
    plots.axes(cell, "peaks", "fifth of the cycles", peak, x_axis=x, y_axis=FROM_ZERO)
    if not at:
        return
    fifths = np.arange(SLICES, dtype=np.float64)
    values = lines_of(case, lambda numbers: _slices(case, numbers, at[0]))
    floor = case.findings.floor[at[0]]
    low, high = (values["nominal twin"] + sign * floor for sign in (-1, 1))
    plots.band(cell, fifths, np.exp(low), np.exp(high), "linear")
    for whose, logarithms in values.items():
        style = replace(LINES.get(whose, RUNNER_UP), mode="lines+markers", size=5)
        plots.line(cell, whose, fifths, np.exp(logarithms), style)


def _draw(
    plots: Plots, cell: int, case: Case, at: list[int], edges: Array, shown: Callable[[Array], Array]
) -> None:
    """Steps over `edges`, of cells' means as `shown`."""
    if not at:
        return
    values = lines_of(case, lambda numbers: _means(case, numbers, at))
    floor = case.findings.floor[at]
    low, high = (shown(values["nominal twin"] + sign * floor) for sign in (-1, 1))
    plots.band(cell, edges, _to_the_end(low), _to_the_end(high), "hv")
    for whose, means in values.items():
        style = LINES.get(whose, RUNNER_UP)
        plots.line(cell, whose, edges, _to_the_end(shown(means)), style, shape="hv")


def lines_of(case: Case, of: Callable[[Array], Array]) -> dict[str, Array]:
    """What is shown of the mean fingerprints (numbers,): measured, of the twins, and of the runner-up's."""
    found = case.findings
    lines = {"measured": of(found.measured), "nominal twin": of(found.nominal)}
    if found.repaired is not None:
        lines["repaired twin"] = of(found.repaired)
    if found.runner_up is not None:
        causes, numbers = found.runner_up
        lines[f"with {listed([plain(cause.name) for cause in causes])} instead"] = of(numbers)
    return lines


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


_FORCES_SHOWN = 2
_FORCE_ROW_PX = 230
_SHOWN_UNITS = {"m": ("mm", 1e3), "m/s": ("m/s", 1.0), "": ("", 1.0)}
_CLOSE = 1e-4
"""m; shorter ways are told in micrometres."""
_FORCE_CAPTION = (
    "Mean force, reconstructed from the recorded channels and from twins' in the same way. What the measured "
    "line has beside the grey band (two standard deviations of healthy rigs) is the latent force: "
    "what acts there and is not in the twin."
)


def latent_force(case: Case) -> list[Part]:
    """A row of plots for each of the joints whose forces are furthest from the twin's."""
    shown = [each for each in case.forces if each.size > 0][:_FORCES_SHOWN]
    if not shown:
        return []
    plots = Plots(len(shown), len(shown[0].curves), _FORCE_ROW_PX, legend=True)
    for row, latent in enumerate(shown):
        for column, curve in enumerate(latent.curves):
            cell = row * len(latent.curves) + column
            unit, factor = _unit(curve)
            label = f"{curve.axis.name}, {unit}" if unit else curve.axis.name
            plots.axes(cell, latent.joint, label, "mean force, N")
            middles = factor * (curve.edges[:-1] + curve.edges[1:]) / 2
            known = np.isfinite(curve.twin)
            low, high = (curve.twin + sign * 2 * curve.scatter for sign in (-1, 1))
            plots.band(cell, middles[known], low[known], high[known], "linear")
            plots.line(cell, "measured", middles, curve.measured, LINES["measured"])
            plots.line(cell, "nominal twin", middles, curve.twin, LINES["nominal twin"])
    curve = max(shown[0].curves, key=lambda each: each.size)
    where = f" in {case.run_name(shown[0].run)}" if len(case.runs) > 1 else ""
    off = np.where(np.isfinite(curve.latent / curve.scatter), np.abs(curve.latent / curve.scatter), 0.0)
    at = int(np.argmax(off))
    unit, factor = _unit(curve)
    place = estimate(factor * float(curve.edges[at : at + 2].mean()), unit)
    force = estimate(abs(curve.latent[at]), "N")
    more = "more" if curve.latent[at] > 0 else "less"
    told = (
        f"Furthest from the twin's is the mean force at the {shown[0].joint}{where}: {force} {more} "
        f"at a {curve.axis.name} of {place}, {off[at]:.1f} times the scatter of healthy rigs."
    )
    return [Sentence(told), plots.figure("latent-force", _FORCE_CAPTION)]


def _unit(curve: Curve) -> tuple[str, float]:
    if curve.axis.unit == "m" and np.max(np.abs(curve.edges)) < _CLOSE:
        return "µm", 1e6
    return _SHOWN_UNITS[curve.axis.unit]
