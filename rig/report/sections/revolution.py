"""Measured over predicted over the crank angle: one revolution, and the mean of all."""

from __future__ import annotations

from math import ceil, floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.errors import UnphysicalParameter
from daq.log.reader import Origin
from daq.signals import envelope, synchronous_average
from rig.report.content import Part, Sentence
from rig.report.plot import PlotGrid, points_each
from rig.report.record import ORIGINS, RunRecord, Trace
from rig.report.turning import turns_of

_ROW_PX = 150
_COLUMNS = 2
_POINTS = 1440
"""Of a mean revolution: every quarter of a degree."""

_REMARK = (
    "The motion chatters: no single blow of one revolution has to meet the twin's. What stays in the mean of "
    "all revolutions (at every 0.25°) may be compared as it stands; the fewer they are, the more of their "
    "scatter is left in it."
)
_ANGLE = {"title": {"text": "crank angle, °"}, "range": [0, 360], "tickvals": list(range(0, 361, 45))}
_CAPTION = "Drag to zoom, double-click to go back. The crank angle axes move together."


class _Line(NamedTuple):
    """Crank angle in degrees and what a channel showed there, both of shape (m,)."""

    degrees: NDArray[np.float64]
    values: NDArray[np.floating]


def parts(run: RunRecord) -> list[Part]:
    """A row of two plots for each channel that vibrates; nothing for a rig without a crank."""
    if run.crank is None:
        return []
    turns = _turns(run)
    if not turns:
        return [Sentence("No whole revolution with a known crank angle in this run.")]
    names = [name for name in run.channels if name not in run.crank.plain]
    grid = PlotGrid(rows=len(names), columns=_COLUMNS, row_px=_ROW_PX)
    for row, name in enumerate(names):
        for column, what in enumerate(("one revolution", "mean of all revolutions")):
            title = f"{name} [{run.channels[name].unit or '-'}], {what}"
            grid.axes(_COLUMNS * row + column, title, _ANGLE, {}, share_x_with=0)
    points = points_each(len(turns) * len(names) * _COLUMNS)
    for origin, way in turns.items():
        traces = {name: trace for name in names if (trace := run.traces.get((origin, name))) is not None}
        for name, lines in _lines(traces, way).items():
            for column, line in enumerate(lines):
                cell, chosen = _COLUMNS * names.index(name) + column, envelope(line.values, points)
                grid.line(cell, run.whose(origin), line.degrees[chosen.indices], chosen.values, name)
    return [Sentence(_REMARK), grid.figure("revolution", _CAPTION)]


def _turns(run: RunRecord) -> dict[Origin, NDArray[np.float64]]:
    """Turns of the origins in which the crank turns once at least."""
    found = {origin: turns_of(run, origin) for origin in ORIGINS}
    return {
        origin: turns for origin, turns in found.items() if turns is not None and _whole(turns) is not None
    }


def _lines(traces: dict[str, Trace], turns: NDArray[np.float64]) -> dict[str, tuple[_Line, _Line]]:
    """One revolution and the mean of all, by channel."""
    count = min((len(trace.values) for trace in traces.values()), default=0)
    whole = _whole(turns[:count])
    if whole is None:
        return {}
    values = np.array([trace.values[:count] for trace in traces.values()])
    ones, means = _one(values, turns[:count], whole), _mean(values, turns[:count])
    return dict(zip(traces, zip(ones, means, strict=True), strict=True))


def _whole(turns: NDArray[np.float64]) -> tuple[int, int] | None:
    """The first of the whole revolutions and the one after the last; None where there is none."""
    known = turns[np.isfinite(turns)]
    if not len(known):
        return None
    first, end = ceil(float(known.min())), floor(float(known.max()))
    return (first, end) if end > first else None


def _one(values: NDArray[np.float32], turns: NDArray[np.float64], whole: tuple[int, int]) -> list[_Line]:
    """The revolution in the middle of the run, away from the start's transients."""
    known = np.flatnonzero(np.isfinite(turns))
    middle = floor(float(turns[known[len(known) // 2]]))
    chosen = min(max(middle, whole[0]), whole[1] - 1)
    inside = np.flatnonzero((turns >= chosen) & (turns <= chosen + 1))
    return [_Line(360.0 * (turns[inside] - chosen), row[inside]) for row in values]


def _mean(values: NDArray[np.float32], turns: NDArray[np.float64]) -> list[_Line]:
    try:
        mean = synchronous_average(values, turns, _POINTS).mean
    except UnphysicalParameter:  # a hole so long that nobody knows how often the crank turned in it
        return [_Line(np.empty(0), np.empty(0))] * len(values)
    return [_Line(360.0 * np.arange(_POINTS) / _POINTS, row) for row in mean]
