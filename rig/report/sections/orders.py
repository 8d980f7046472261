"""Order spectra, measured and of the twin or twins: amplitudes over multiples of the crank's speed."""

from __future__ import annotations

from math import ceil, log10

import numpy as np
from numpy.typing import NDArray

from rig.crank.order_lines import HIGHEST_ORDER, LOWEST_ORDER, TURNS, largest_in_bands
from rig.pages.content import Part, Sentence, Table
from rig.pages.plots import Plots
from rig.pages.words import DASH, number
from rig.report.crank_figures import beside_turns, counted_by, order_lines
from rig.report.record import ORIGINS, RunRecord
from rig.report.sections.remarks import cut, left_out

_ROW_PX = 190
_COLUMNS = 2
_DECADES = 5
_IN_TABLE = (1, 2, 3, 4)
_TICKS = (0.5, 1, 2, 5, 10, 20, 50, 100, 200)
_EXPLANATION = (
    f"Order 1 is once a revolution. Amplitudes are zero to peak, over blocks of {TURNS} revolutions at even "
    "angles (Hann window, half overlap), rms over the blocks of the run."
)

Lines = dict[str, NDArray[np.float64]]


def parts(run: RunRecord) -> list[Part]:
    """A plot for each channel that vibrates, both axes logarithmic; nothing for a rig without a shaft."""
    if not run.roles.turns:
        return []
    if all(counted_by(run, origin) is None for origin in ORIGINS):
        return [Sentence("No encoder and no marker in this run: nothing to count orders by.")]
    channels = list(run.roles.vibration)
    found = _found(run, channels)
    if not found:
        few = Sentence(f"Fewer than {TURNS} whole revolutions with a known angle: no order spectrum.")
        return [few, *left_out(run, channels)]
    return [
        Sentence(_EXPLANATION),
        *cut(run),
        *left_out(run, channels),
        _figure(run, found),
        _table(run, found),
    ]


def _found(run: RunRecord, channels: list[str]) -> dict[str, Lines]:
    """Amplitudes by channel and by whose they are; only those that there are."""
    found: dict[str, Lines] = {name: {} for name in channels}
    for origin in ORIGINS:
        names = list(beside_turns(run, origin, channels))
        lines = order_lines(run, origin, names)
        if lines is None or lines.amplitude is None:
            continue
        for name, amplitude in zip(names, lines.amplitude, strict=True):
            found[name][run.whose(origin)] = amplitude
    return {name: lines for name, lines in found.items() if lines}


def _figure(run: RunRecord, found: dict[str, Lines]) -> Part:
    grid = Plots(rows=ceil(len(found) / _COLUMNS), columns=_COLUMNS, row_px=_ROW_PX)
    x = {
        "type": "log",
        "range": [log10(LOWEST_ORDER), log10(HIGHEST_ORDER)],
        "tickvals": list(_TICKS),
    }
    for cell, (name, lines) in enumerate(found.items()):
        bands = {whose: largest_in_bands(_orders(each), each) for whose, each in lines.items()}
        y = {"type": "log", "exponentformat": "power", "dtick": 1, "range": _decades(bands)}
        title = f"{name}, {run.channels[name].unit or '-'}"
        grid.axes(cell, title, "order", x_axis=x, y_axis=y, share_x_with=0)
        for whose, (order, amplitude) in bands.items():
            grid.line(cell, whose, order, amplitude, subject=name)
    return grid.figure("orders", "Drag to zoom. The order axes move together.")


def _decades(bands: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]) -> list[float]:
    """Range of an axis that holds all amplitudes, but not what lies too far below the largest."""
    every = np.concatenate([amplitude for _, amplitude in bands.values()])
    if not len(every):
        return [-1.0, 0.0]
    high = log10(1.5 * float(every.max()))
    return [max(log10(float(every.min()) / 1.5), high - _DECADES), high]


def _table(run: RunRecord, found: dict[str, Lines]) -> Table:
    rows = [
        [
            f"{name}, {whose}",
            run.channels[name].unit,
            *_strongest(amplitude),
            *(number(float(amplitude[TURNS * order])) for order in _IN_TABLE),
        ]
        for name, lines in found.items()
        for whose, amplitude in lines.items()
    ]
    headings = (
        "channel, whose",
        "unit",
        "strongest order",
        "its amplitude",
        *(f"order {order}" for order in _IN_TABLE),
    )
    return Table(headings, rows, "Amplitudes of the strongest and of the first orders")


def _strongest(amplitude: NDArray[np.float64]) -> tuple[str, str]:
    order, heard = largest_in_bands(_orders(amplitude), amplitude)
    if not len(heard):
        return DASH, DASH
    at = int(np.argmax(heard))
    return number(float(order[at])), number(float(heard[at]))


def _orders(amplitude: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.arange(len(amplitude)) / TURNS
