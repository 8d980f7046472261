"""Measured over predicted: in time and over the crank angle, one cycle and the mean of all."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from math import ceil, floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.errors import ConfigurationError
from daq.signals.even_angles import CycleAverage
from rig.derived.settings import nominal_of
from rig.files.scenario import parse_scenario
from rig.pages.content import Part, Sentence
from rig.pages.plots import SCATTER, Plots, points_each
from rig.report.crank_figures import beside_turns, cut, in_pieces, left_out, turns_of
from rig.report.record import DRAWN, ORIGINS, RunRecord, Trace

_IMPACTS_SHOWN = 2
_BEFORE_S, _AFTER_S = 0.001, 0.002
_WITHOUT_IMPACTS_S = 0.05
_ROW_PX = 150
_COLUMNS = 2
_MEAN_POINTS = 400

_SCATTER_CAPTION = "The band is one standard deviation of the measured cycles about their mean. "
_CAPTION = "Drag to zoom, double-click to go back. The time axes of a column move together."
_FROM_REST = (
    "The drive began in this run: the first impacts may be compared wave by wave, later ones may not."
)
_RUNNING = (
    "The drive was running before this run, so that no single wave of a twin has to meet the measured one."
)
_NO_CYCLE = (
    "there is no mean of all cycles, and nobody knows whether the drive began in this run, so that its waves "
    "may not be compared wave by wave."
)
_MEAN = "The mean of all cycles may be compared as it stands, and so may the distributions and spectra below."
_SET_IN_S = 0.5
_SET_IN = f"Cycles count in the mean from {_SET_IN_S:g} s on."


class Cycle(NamedTuple):
    """The drive's cycle or the crank's revolution: frequency in Hz, phase at sample 0 in rad.

    `from_rest` is True where the drive began within the record.
    """

    frequency_hz: float
    phase_rad: float
    from_rest: bool


def cycle_of(run: RunRecord) -> Cycle | None:
    """The cycle that an overlay notes in its log, else that of the measured drive; None where neither is."""
    record = run.metadata.get("twin", {})
    try:
        frequency_hz, phase_rad = float(record["cycle_hz"]), float(record["cycle_phase_rad"])
    except ValueError:
        return None
    except KeyError:
        return _measured_cycle(run)
    if not (math.isfinite(phase_rad) and 0 < frequency_hz < math.inf):
        return None
    return Cycle(frequency_hz, phase_rad, record.get("from_rest") == "true")


def _measured_cycle(run: RunRecord) -> Cycle | None:
    try:
        scenario = parse_scenario(run.scenario)
        nominal = nominal_of(scenario, run.mounting)
    except ConfigurationError:
        return None
    trace = run.traces.get(("measured", nominal.reference.channel))
    if trace is None or not nominal.reference.channel:
        return None
    found = nominal.reference.align(trace.values, trace.sample_rate, 0, nominal.drive)
    return Cycle(found.frequency, found.phase, found.onset is not None) if found.trusted else None


class MeanCycle(NamedTuple):
    """Shares of a cycle, mean and deviation of all finite samples there, each of shape (m,)."""

    share: NDArray[np.float64]
    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]


def mean_cycle(trace: Trace, cycle: Cycle) -> MeanCycle:
    """The mean of all cycles of a trace, from rest of those once it swings; empty without a finite sample."""
    finite = np.flatnonzero(np.isfinite(trace.values))
    times = trace.begins_s + finite / trace.sample_rate
    if cycle.from_rest and (set_in := times >= _SET_IN_S).any():  # neither standstill nor the first swings
        finite, times = finite[set_in], times[set_in]
    turns = times * cycle.frequency_hz + cycle.phase_rad / (2 * np.pi)
    count = max(1, min(_MEAN_POINTS, round(trace.sample_rate / cycle.frequency_hz)))
    place = np.minimum((turns % 1.0 * count).astype(np.int64), count - 1)
    seen = np.bincount(place, minlength=count)
    values = trace.values[finite].astype(np.float64)
    filled = seen > 0
    mean, square = (np.bincount(place, each, count)[filled] / seen[filled] for each in (values, values**2))
    deviation = np.sqrt(np.maximum(square - mean**2, 0.0))
    return MeanCycle((np.flatnonzero(filled) + 0.5) / count, mean, deviation)


class _Window(NamedTuple):
    title: str
    start_s: float
    end_s: float


def parts(run: RunRecord) -> list[Part]:
    """A row of two plots for each channel: from rest its first impacts, else one cycle; the mean of all.

    Nothing for a rig with a shaft, whose channels are shown over its angle.
    """
    if run.roles.turns:
        return []
    if not run.traces:
        return [Sentence("The log holds no samples.")]
    cycle = cycle_of(run)
    impacts = _first_impacts(run)
    windows = [impacts or _Window("the beginning", 0.0, _WITHOUT_IMPACTS_S), _one_cycle(run, cycle)]
    if cycle is not None:  # wave by wave a twin can be held against a run only from rest on
        windows = windows[:1] if cycle.from_rest else windows[1:]
    plots = Plots(rows=len(run.channels), columns=_COLUMNS, row_px=_ROW_PX)
    points = points_each(len(run.traces) * _COLUMNS)
    for row, name in enumerate(run.channels):
        title, left = f"{name} [{run.unit(name) or '-'}]", _COLUMNS * row
        traces = {
            run.whose(origin): run.written(origin, name) for origin in DRAWN if (origin, name) in run.traces
        }
        for column, window in enumerate(windows):
            time = f"ms after {window.start_s:.4f} s"
            plots.axes(left + column, f"{title}, {window.title}", time, share_x_with=column)
            for whose, trace in traces.items():
                times, values = trace.window(window.start_s, window.end_s)
                moments = 1e3 * (times - window.start_s)
                plots.outline(left + column, whose, moments, values, subject=name, points=points)
        if cycle is not None and name not in run.roles.unwrapped:
            whole = {"range": [0, 1]}
            plots.axes(left + 1, f"{title}, mean of all cycles", "share of a cycle", x_axis=whole)
            for whose, trace in traces.items():
                mean = mean_cycle(trace, cycle)
                if whose == "measured":
                    ends = mean.mean - mean.deviation, mean.mean + mean.deviation
                    plots.band(left + 1, mean.share, *ends, name="scatter", colour=SCATTER, subject=name)
                plots.line(left + 1, whose, mean.share, mean.mean, subject=name)
    caption = _CAPTION if cycle is None else _SCATTER_CAPTION + _CAPTION
    return [*_remark(run, cycle, impacts), plots.figure("overlays", caption)]


def _remark(run: RunRecord, cycle: Cycle | None, impacts: _Window | None) -> list[Sentence]:
    if cycle is not None:
        return [Sentence(f"{_FROM_REST} {_MEAN} {_SET_IN}" if cycle.from_rest else f"{_RUNNING} {_MEAN}")]
    told = [Sentence(f"{_why_no_cycle(run)}: {_NO_CYCLE}")]
    if impacts is None:
        stops = run.roles.stops
        what = "impact" if stops and run.channels.keys() >= {*stops} else "contact forces"
        told.append(Sentence(f"No {what} in this run: the left column shows its beginning."))
    return told


def _why_no_cycle(run: RunRecord) -> str:
    """Why nobody can tell the drive's cycle."""
    if "cycle_hz" in run.metadata.get("twin", {}):
        return "What this log notes of its cycle cannot be read"
    try:
        channel = nominal_of(parse_scenario(run.scenario)).reference.channel
    except ConfigurationError:
        return "What was driven is not known, for the scenario in this log cannot be read"
    if ("measured", channel) not in run.traces:
        return f"The drive cannot be followed, for {channel or 'what shows it'} was not measured"
    return f"The drive cannot be followed, for {channel} does not show it"


def _first_impacts(run: RunRecord) -> _Window | None:
    """The first impacts, the measured, or the predicted if none is; None where there are none at all."""
    stops = run.roles.stops or ()
    for origin in ORIGINS:
        found = [
            each
            for each in run.impacts
            # one that the record's start cuts shows nothing
            if each.origin == origin and each.channel in stops and each.first_sample > 0
        ]
        if found:
            ordered = sorted(found, key=lambda each: each.first_sample)[:_IMPACTS_SHOWN]
            rate = run.traces[origin, ordered[0].channel].sample_rate
            start, end = ordered[0].first_sample / rate, ordered[-1].end_sample / rate
            return _Window("first impacts", max(start - _BEFORE_S, 0.0), end + _AFTER_S)
    return None


def _one_cycle(run: RunRecord, cycle: Cycle | None) -> _Window:
    duration = max(trace.end_s for trace in run.traces.values())
    cycle_s = run.facts.cycle_s
    if cycle_s is None:
        return _Window("the first second", 0.0, min(1.0, duration))
    if duration < cycle_s:
        return _Window("the whole run", 0.0, duration)
    start = (duration - cycle_s) / 2  # the middle of the run: away from the start's transients
    if cycle is not None:  # and where the mean cycle begins
        turns = start * cycle.frequency_hz + cycle.phase_rad / (2 * np.pi)
        start = max(start - turns % 1.0 / cycle.frequency_hz, 0.0)
    return _Window("one drive cycle", start, start + cycle_s)


_POINTS = 1440
"""Of a mean revolution: every quarter of a degree."""
_LEAP = 0.5
"""Turns from sample to sample beyond which an angle cannot be told from another."""

_REVOLUTION = (
    "The motion chatters: no single impact of one revolution has to meet the twin's. What stays in the mean "
    "of all revolutions (at every 0.25°, what is faster filtered out) may be compared as it stands; the "
    "fewer they are, the more of their scatter is left in it."
)
_DEGREES = {"range": [0, 360], "tickvals": list(range(0, 361, 45))}
_TURNED_CAPTION = "Drag to zoom, double-click to go back. The crank angle axes move together."


class _Line(NamedTuple):
    """Crank angle in degrees and what a channel showed there, both of shape (m,)."""

    degrees: NDArray[np.float64]
    values: NDArray[np.floating]


class _Mean(NamedTuple):
    """Of all revolutions of a channel: their mean, their deviation from it, and how many they are."""

    line: _Line
    deviation: NDArray[np.float64]
    revolutions: int


def revolution(run: RunRecord) -> list[Part]:
    """A row of two plots for each channel that vibrates; nothing for a rig without a shaft."""
    if not run.roles.turns:
        return []
    channels = tuple(name for name in run.roles.vibration if name not in run.still)
    still = [name for name in run.roles.vibration if name in run.still]
    every = {origin: turns_of(run, origin) for origin in DRAWN}
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
            title = f"{name} [{run.unit(name) or '-'}], {what}"
            plots.axes(_COLUMNS * row + column, title, "crank angle, °", x_axis=_DEGREES, share_x_with=0)
    points = points_each(len(run.traces) * _COLUMNS)
    told = []
    for origin, way in turns.items():
        whose, revolutions = run.whose(origin), _revolutions(traces[origin], way)
        for name, (one, mean) in revolutions.items():
            left = _COLUMNS * names.index(name)
            if whose == "measured":
                ends = mean.line.values - mean.deviation, mean.line.values + mean.deviation
                plots.band(left + 1, mean.line.degrees, *ends, name="scatter", colour=SCATTER, subject=name)
            for cell, line in enumerate((one, mean.line), left):
                plots.outline(cell, whose, line.degrees, line.values, subject=name, points=points)
        counts = [mean.revolutions for _, mean in revolutions.values()] or [0]
        least, most = min(counts), max(counts)  # channels with holes may have fewer
        told.append(f"{least} to {most} {whose}" if most > least else f"{most} {whose}")
    return [
        Sentence(_REVOLUTION),
        *cut(run),
        Sentence(f"Revolutions in the mean: {', '.join(told)}."),
        *[
            Sentence(f"Not drawn, for the twin says 0 there and the sensor shows noise: {name}.")
            for name in still
        ],
        *left_out(run, channels),
        plots.figure("revolution", _SCATTER_CAPTION + _TURNED_CAPTION),
    ]


def _revolutions(traces: dict[str, Trace], turns: NDArray[np.float64]) -> dict[str, tuple[_Line, _Mean]]:
    """By channel one revolution, and the mean of all.

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
    for (name, trace), mean in zip(traces.items(), _means(list(traces.values()), turns), strict=True):
        at = inside[inside < len(trace.values)]
        found[name] = _Line(360.0 * (turns[at] - chosen), trace.values[at]), mean
    return found


def _whole(turns: NDArray[np.float64]) -> tuple[int, int] | None:
    """The first of the whole revolutions and the one after the last; None where there is none."""
    known = turns[np.isfinite(turns)]
    if not len(known):
        return None
    first, end = ceil(float(known.min())), floor(float(known.max()))
    return (first, end) if end > first else None


def _means(traces: list[Trace], turns: NDArray[np.float64]) -> list[_Mean]:
    """Mean revolution of each trace, NaN without any.

    Where the angle leaps behind a hole, more than half a turn from the last that was known, counting begins
    anew; the mean is over the cycles of all such stretches.
    """
    known = np.flatnonzero(np.isfinite(turns))
    leaps = known[1:][np.abs(np.diff(turns[known])) > _LEAP]
    total, squares = np.zeros((2, len(traces), _POINTS))
    cycles = np.zeros((len(traces), 1))
    for first, end in pairwise((0, *map(int, leaps), len(turns))):
        if _whole(turns[first:end]) is None:
            continue
        average = CycleAverage(_POINTS)
        stretch = [replace(trace, values=trace.values[first:end]) for trace in traces]
        for values, way in in_pieces(stretch, turns[first:end]):
            average.add(values, way)
        each = average.result()
        if each.cycles.ndim:  # else nothing was added to it
            count = each.cycles[:, None]
            mean = np.where(count > 0, each.mean, 0.0)
            total += count * mean
            squares += count * (mean**2 + np.where(count > 1, each.standard_error, 0.0) ** 2 * (count - 1))
            cycles += count
    known = np.where(cycles > 0, cycles, np.nan)
    mean, square = total / known, squares / known
    deviation = np.sqrt(np.maximum(square - mean**2, 0.0))
    degrees = 360.0 * np.arange(_POINTS) / _POINTS
    rows = zip(mean, deviation, cycles[:, 0], strict=True)
    return [_Mean(_Line(degrees, row), off, int(count)) for row, off, count in rows]
