"""Measured over predicted over the crank angle: one revolution, and the mean of all."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import ceil, floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.signals.synchronous import CycleAverage
from rig.pages.content import Part, Sentence
from rig.pages.plots import Plots, points_each
from rig.report.crank_figures import beside_turns, in_pieces, turns_of
from rig.report.record import ORIGINS, RunRecord, Trace
from rig.report.sections.remarks import cut, left_out

_ROW_PX = 150
_COLUMNS = 2
_POINTS = 1440
"""Of a mean revolution: every quarter of a degree."""
_LEAP = 0.5
"""Turns from sample to sample beyond which an angle cannot be told from another."""

_REMARK = (
    "The motion chatters: no single impact of one revolution has to meet the twin's. What stays in the mean "
    "of all revolutions (at every 0.25°, what is faster filtered out) may be compared as it stands; the "
    "fewer they are, the more of their scatter is left in it."
)
_DEGREES = {"range": [0, 360], "tickvals": list(range(0, 361, 45))}
_CAPTION = "Drag to zoom, double-click to go back. The crank angle axes move together."


class _Line(NamedTuple):
    """Crank angle in degrees and what a channel showed there, both of shape (m,)."""

    degrees: NDArray[np.float64]
    values: NDArray[np.floating]


class _Revolution(NamedTuple):
    """One revolution of a channel, and the mean of how many."""

    one: _Line
    mean: _Line
    cycles: int


def parts(run: RunRecord) -> list[Part]:
    """A row of two plots for each channel that vibrates; nothing for a rig without a shaft."""
    if not run.roles.turns:
        return []
    channels = run.roles.vibration
    every = {origin: turns_of(run, origin) for origin in ORIGINS}
    turns = {origin: way for origin, way in every.items() if way is not None and _whole(way) is not None}
    if not turns:
        none = Sentence("No whole revolution with a known crank angle in this run.")
        return [none, *left_out(run, channels)]
    traces = {origin: beside_turns(run, origin, channels) for origin in turns}
    names = [name for name in channels if any(name in each for each in traces.values())]
    if not names:
        return [*left_out(run, channels)]
    plots = Plots(rows=len(names), columns=_COLUMNS, row_px=_ROW_PX)
    for row, name in enumerate(names):
        for column, what in enumerate(("one revolution", "mean of all revolutions")):
            title = f"{name} [{run.channels[name].unit or '-'}], {what}"
            plots.axes(_COLUMNS * row + column, title, "crank angle, °", x_axis=_DEGREES, share_x_with=0)
    points = points_each(len(run.traces) * _COLUMNS)
    told = []
    for origin, way in turns.items():
        whose, revolutions = run.whose(origin), _revolutions(traces[origin], way)
        for name, each in revolutions.items():
            for cell, line in enumerate((each.one, each.mean), _COLUMNS * names.index(name)):
                plots.outline(cell, whose, line.degrees, line.values, subject=name, points=points)
        counts = [each.cycles for each in revolutions.values()] or [0]
        least, most = min(counts), max(counts)  # channels with holes may have fewer
        told.append(f"{least} to {most} {whose}" if most > least else f"{most} {whose}")
    return [
        Sentence(_REMARK),
        *cut(run),
        Sentence(f"Revolutions in the mean: {', '.join(told)}."),
        *left_out(run, channels),
        plots.figure("revolution", _CAPTION),
    ]


def _revolutions(traces: dict[str, Trace], turns: NDArray[np.float64]) -> dict[str, _Revolution]:
    """One revolution and the mean of all, by channel.

    The one is from the middle of the run, away from the start's transients.
    """
    whole = _whole(turns)
    if whole is None or not traces:
        return {}
    known = np.flatnonzero(np.isfinite(turns))
    middle = floor(float(turns[known[len(known) // 2]]))
    chosen = min(max(middle, whole[0]), whole[1] - 1)
    inside = np.flatnonzero((turns >= chosen) & (turns <= chosen + 1))
    found = {}
    for (name, trace), (mean, count) in zip(
        traces.items(), _means(list(traces.values()), turns), strict=True
    ):
        at = inside[inside < len(trace.values)]
        found[name] = _Revolution(_Line(360.0 * (turns[at] - chosen), trace.values[at]), mean, count)
    return found


def _whole(turns: NDArray[np.float64]) -> tuple[int, int] | None:
    """The first of the whole revolutions and the one after the last; None where there is none."""
    known = turns[np.isfinite(turns)]
    if not len(known):
        return None
    first, end = ceil(float(known.min())), floor(float(known.max()))
    return (first, end) if end > first else None


def _means(traces: list[Trace], turns: NDArray[np.float64]) -> list[tuple[_Line, int]]:
    """Mean revolution of each trace, NaN without any, and of how many it is.

    Where the angle leaps behind a hole, more than half a turn from the last that was known, counting begins
    anew; the mean is over the cycles of all such stretches.
    """
    known = np.flatnonzero(np.isfinite(turns))
    leaps = known[1:][np.abs(np.diff(turns[known])) > _LEAP]
    total, cycles = np.zeros((len(traces), _POINTS)), np.zeros((len(traces), 1))
    for first, end in pairwise((0, *map(int, leaps), len(turns))):
        if _whole(turns[first:end]) is None:
            continue
        average = CycleAverage(_POINTS)
        stretch = [replace(trace, values=trace.values[first:end]) for trace in traces]
        for values, way in in_pieces(stretch, turns[first:end]):
            average.add(values, way)
        each = average.result()
        if each.cycles.ndim:  # else nothing was added to it
            total += np.where(each.cycles[:, None] > 0, each.mean * each.cycles[:, None], 0.0)
            cycles += each.cycles[:, None]
    mean = np.divide(total, cycles, out=np.full_like(total, np.nan), where=cycles > 0)
    degrees = 360.0 * np.arange(_POINTS) / _POINTS
    return [(_Line(degrees, row), int(count)) for row, count in zip(mean, cycles[:, 0], strict=True)]
