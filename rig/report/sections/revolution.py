"""Measured over predicted over the crank angle: one revolution, and the mean of all."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import ceil, floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.log.reader import Origin
from daq.signals import CycleAverage, SynchronousAverage
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
    channels = list(run.roles.vibration)
    turns = _turns(run)
    if not turns:
        return [
            Sentence("No whole revolution with a known crank angle in this run."),
            *left_out(run, channels),
        ]
    traces = {origin: beside_turns(run, origin, channels) for origin in turns}
    names = [name for name in channels if any(name in each for each in traces.values())]
    if not names:
        return [*left_out(run, channels)]
    grid = Plots(rows=len(names), columns=_COLUMNS, row_px=_ROW_PX)
    for row, name in enumerate(names):
        for column, what in enumerate(("one revolution", "mean of all revolutions")):
            title = f"{name} [{run.channels[name].unit or '-'}], {what}"
            grid.axes(_COLUMNS * row + column, title, "crank angle, °", x_axis=_DEGREES, share_x_with=0)
    found = {run.whose(origin): _revolutions(traces[origin], way) for origin, way in turns.items()}
    points = points_each(len(run.traces) * _COLUMNS)
    for whose, revolutions in found.items():
        _draw(grid, whose, names, revolutions, points)
    return [
        Sentence(_REMARK),
        *cut(run),
        Sentence(f"Revolutions in the mean: {_counts(found)}."),
        *left_out(run, channels),
        grid.figure("revolution", _CAPTION),
    ]


def _counts(found: dict[str, dict[str, _Revolution]]) -> str:
    """How many revolutions each origin has a mean of; channels with holes may have fewer."""
    told = []
    for whose, revolutions in found.items():
        counts = [each.cycles for each in revolutions.values()] or [0]
        least, most = min(counts), max(counts)
        told.append(f"{least} to {most} {whose}" if most > least else f"{most} {whose}")
    return ", ".join(told)


def _draw(
    grid: Plots, whose: str, names: list[str], revolutions: dict[str, _Revolution], points: int
) -> None:
    for name, each in revolutions.items():
        for column, line in enumerate((each.one, each.mean)):
            cell = _COLUMNS * names.index(name) + column
            grid.outline(cell, whose, line.degrees, line.values, subject=name, points=points)


def _turns(run: RunRecord) -> dict[Origin, NDArray[np.float64]]:
    """Turns of the origins in which the crank turns once at least."""
    found = {origin: turns_of(run, origin) for origin in ORIGINS}
    return {
        origin: turns for origin, turns in found.items() if turns is not None and _whole(turns) is not None
    }


def _revolutions(traces: dict[str, Trace], turns: NDArray[np.float64]) -> dict[str, _Revolution]:
    """One revolution and the mean of all, by channel."""
    whole = _whole(turns)
    if whole is None or not traces:
        return {}
    means = _mean(list(traces.values()), turns)
    return {
        name: _Revolution(_one(trace, turns, whole), mean, count)
        for (name, trace), (mean, count) in zip(traces.items(), means, strict=True)
    }


def _whole(turns: NDArray[np.float64]) -> tuple[int, int] | None:
    """The first of the whole revolutions and the one after the last; None where there is none."""
    known = turns[np.isfinite(turns)]
    if not len(known):
        return None
    first, end = ceil(float(known.min())), floor(float(known.max()))
    return (first, end) if end > first else None


def _one(trace: Trace, turns: NDArray[np.float64], whole: tuple[int, int]) -> _Line:
    """The revolution in the middle of the run, away from the start's transients."""
    known = np.flatnonzero(np.isfinite(turns))
    middle = floor(float(turns[known[len(known) // 2]]))
    chosen = min(max(middle, whole[0]), whole[1] - 1)
    inside = np.flatnonzero((turns >= chosen) & (turns <= chosen + 1))
    inside = inside[inside < len(trace.values)]
    return _Line(360.0 * (turns[inside] - chosen), trace.values[inside])


def _mean(traces: list[Trace], turns: NDArray[np.float64]) -> list[tuple[_Line, int]]:
    """Mean revolutions, and of how many; where the angle leaps behind a hole, counting begins anew."""
    found = []
    for first, end in pairwise((0, *_leaps(turns), len(turns))):
        if _whole(turns[first:end]) is None:
            continue
        average = CycleAverage(_POINTS)
        stretch = [replace(trace, values=trace.values[first:end]) for trace in traces]
        for values, way in in_pieces(stretch, turns[first:end]):
            average.add(values, way)
        found.append(average.result())
    mean, cycles = _together(found, len(traces))
    degrees = 360.0 * np.arange(_POINTS) / _POINTS
    return [(_Line(degrees, row), int(count)) for row, count in zip(mean, cycles, strict=True)]


def _leaps(turns: NDArray[np.float64]) -> list[int]:
    """The samples at which the angle is more than half a turn from the last that was known."""
    known = np.flatnonzero(np.isfinite(turns))
    return [int(at) for at in known[1:][np.abs(np.diff(turns[known])) > _LEAP]]


def _together(
    averages: list[SynchronousAverage], channels: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean over the cycles of all averages, shape (channels, points), NaN without one; and how many."""
    total, cycles = np.zeros((channels, _POINTS)), np.zeros((channels, 1))
    for each in averages:
        if each.cycles.ndim:  # else nothing was added to it
            total += np.where(each.cycles[:, None] > 0, each.mean * each.cycles[:, None], 0.0)
            cycles += each.cycles[:, None]
    return np.divide(total, cycles, out=np.full_like(total, np.nan), where=cycles > 0), cycles[:, 0]
