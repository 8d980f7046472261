"""Autospectra and order spectra, measured and of the twin or twins."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log10, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.signals.spectrum import autospectrum, log_bands
from rig.derived.order_lines import HIGHEST_ORDER, LOWEST_ORDER, TURNS, largest_in_bands
from rig.pages.content import Part, Sentence, Table
from rig.pages.plots import Plots
from rig.pages.words import DASH, number, numbers
from rig.report.crank_figures import beside_turns, counted_by, cut, left_out, order_lines
from rig.report.record import DRAWN, ORIGINS, RunRecord

_ROW_PX = 190
_BANDS = 500
_SPECTRUM_DECADES = 10
"""Further down lie rounding and the feet of filters, which nobody measures."""
_COLUMNS = 2


def parts(run: RunRecord) -> list[Part]:
    """One plot for each channel that vibrates, both axes logarithmic."""
    if not run.traces:
        return [Sentence("The log holds no samples.")]
    channels = run.roles.vibration
    grid = Plots(rows=-(-len(channels) // _COLUMNS), columns=_COLUMNS, row_px=_ROW_PX)
    empty: list[str] = []
    short: list[str] = []
    for cell, name in enumerate(channels):
        unit = run.unit(name)
        unit = unit if unit.isalpha() else f"({unit or '-'})"
        traces = {origin: run.written(origin, name) for origin in DRAWN if (origin, name) in run.traces}
        found = {
            run.whose(origin): log_bands(autospectrum(trace.values, trace.sample_rate), _BANDS)
            for origin, trace in traces.items()
        }
        y: dict[str, Any] = {"type": "log", "exponentformat": "power", "nticks": 4}
        densities = np.array([density for each in found.values() for density in each.density if density > 0])
        if len(densities):  # all, but not what lies too far below the largest
            high = log10(2.0 * float(densities.max()))
            y["range"] = [max(log10(float(densities.min()) / 2.0), high - _SPECTRUM_DECADES), high]
        x = {"type": "log", "dtick": 1}
        grid.axes(cell, f"{name}, {unit}²/Hz", "frequency, Hz", x_axis=x, y_axis=y, share_x_with=0)
        for whose, spectrum in found.items():
            heard = spectrum.density > 0
            grid.line(cell, whose, spectrum.frequency_hz[heard], spectrum.density[heard], subject=name)
            if not heard.any():
                (empty if len(spectrum.density) else short).append(f"{name} ({whose})")
    text = "Welch: Hann window, 0.5 s segments, half overlap, mean removed; averaged over narrow bands."
    missing = [
        Sentence(f"{why}: {', '.join(of)}.")
        for why, of in (("Zero throughout", empty), ("Too few samples for a spectrum", short))
        if of
    ]
    return [
        Sentence(text),
        *missing,
        grid.figure("spectra", "Drag to zoom. The frequency axes move together."),
    ]


_DECADES = 5
_IN_TABLE = (1, 2, 3, 4)
_TICKS = (0.5, 1, 2, 5, 10, 20, 50, 100, 200)
_EXPLANATION = (
    f"Order 1 is once a revolution. Amplitudes are zero to peak, over blocks of {TURNS} revolutions at even "
    "angles (Hann window, half overlap), rms over the blocks of the run."
)

Array = NDArray[np.float64]


def orders(run: RunRecord) -> list[Part]:
    """A plot for each channel that vibrates, both axes logarithmic; nothing for a rig without a shaft."""
    if not run.roles.turns:
        return []
    if all(counted_by(run, origin) is None for origin in ORIGINS):
        return [Sentence("No encoder and no marker in this run: nothing to count orders by.")]
    channels = run.roles.vibration
    found = _amplitudes(run, channels)
    if not found:
        few = Sentence(f"Fewer than {TURNS} whole revolutions with a known angle: no order spectrum.")
        return [few, *left_out(run, channels)]
    plots = Plots(rows=ceil(len(found) / _COLUMNS), columns=_COLUMNS, row_px=_ROW_PX)
    x = {"type": "log", "range": [log10(LOWEST_ORDER), log10(HIGHEST_ORDER)], "tickvals": list(_TICKS)}
    rows = []
    for cell, (name, lines) in enumerate(found.items()):
        unit = run.unit(name)
        bands = {whose: largest_in_bands(np.arange(len(each)) / TURNS, each) for whose, each in lines.items()}
        y = {"type": "log", "exponentformat": "power", "dtick": 1, "range": [-1.0, 0.0]}
        every = np.concatenate([heard for _, heard in bands.values()])
        if len(every):  # all amplitudes, but not what lies too far below the largest
            high = log10(1.5 * float(every.max()))
            y["range"] = [max(log10(float(every.min()) / 1.5), high - _DECADES), high]
        plots.axes(cell, f"{name}, {unit or '-'}", "order", x_axis=x, y_axis=y, share_x_with=0)
        for whose, (order, heard) in bands.items():
            plots.line(cell, whose, order, heard, subject=name)
            at = int(np.argmax(heard)) if len(heard) else None
            strongest = DASH if at is None else number(float(order[at]))
            largest = nan if at is None else float(heard[at])
            amplitudes = numbers([largest, *(float(lines[whose][TURNS * each]) for each in _IN_TABLE)])
            rows.append([f"{name}, {whose}", unit, strongest, *amplitudes])
    orders = (f"order {order}" for order in _IN_TABLE)
    headings = ("channel, whose", "unit", "strongest order", "its amplitude", *orders)
    return [
        Sentence(_EXPLANATION),
        *cut(run),
        *left_out(run, channels),
        plots.figure("orders", "Drag to zoom. The order axes move together."),
        Table(headings, rows, "Amplitudes of the strongest and of the first orders"),
    ]


def _amplitudes(run: RunRecord, channels: Sequence[str]) -> dict[str, dict[str, Array]]:
    found: dict[str, dict[str, Array]] = {name: {} for name in channels}
    for origin in DRAWN:
        names = list(beside_turns(run, origin, channels))
        lines = order_lines(run, origin, names)
        if lines is None or lines.amplitude is None:
            continue
        for name, amplitude in zip(names, lines.amplitude, strict=True):
            found[name][run.whose(origin)] = amplitude
    return {name: lines for name, lines in found.items() if lines}
