"""Measured over predicted in time: the first impacts, one cycle of the drive, and the mean of all cycles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.signals.envelope import envelope
from daq.signals.impacts import find_impacts, largest_force
from rig.report.content import Part, Sentence
from rig.report.mean_cycle import GROWS, Cycle, cycle_of, mean_cycle
from rig.report.plot import PlotGrid, points_each
from rig.report.record import ORIGINS, RunRecord, Trace
from rig.report.scenario_facts import scenario_facts

_CONTACTS_SHOWN = 4
_BEFORE_S, _AFTER_S = 0.001, 0.002
_WITHOUT_IMPACTS_S = 0.05
_ROW_PX = 150
_COLUMNS = 2

_CAPTION = "Drag to zoom, double-click to go back. The time axes of a column move together."
_FROM_REST = (
    "The drive began in this run: the first impacts may be compared wave by wave, later ones may not."
)
_RUNNING = (
    "The drive was running before this run, so that no single wave of a twin has to meet the measured one."
)
_MEAN = "The mean of all cycles may be compared as it stands, and so may the distributions and spectra below."


class _Window(NamedTuple):
    title: str
    start_s: float
    end_s: float


class _Shown(NamedTuple):
    """A channel's traces by whose they are."""

    channel: str
    title: str
    traces: dict[str, Trace]


def parts(run: RunRecord) -> list[Part]:
    """A row of two plots for each channel; with two twins the second is the mean of all cycles.

    Nothing for a rig with a crank, whose channels are shown over its angle.
    """
    if run.crank is not None:
        return []
    if not run.traces:
        return [Sentence("The log holds no samples.")]
    cycle = cycle_of(run)
    windows = _windows(run, cycle)
    grid = PlotGrid(rows=len(run.channels), columns=_COLUMNS, row_px=_ROW_PX)
    points = points_each(len(run.traces) * _COLUMNS)
    for row, (name, channel) in enumerate(run.channels.items()):
        shown = _Shown(name, f"{name} [{channel.unit or '-'}]", _traces_of(run, name))
        for column, window in enumerate(windows):
            _draw_window(grid, row, column, shown, window, points)
        if cycle is not None and not name.endswith(GROWS):
            _draw_mean(grid, row, shown, cycle)
    return [*_remarks(run, cycle), grid.figure("overlays", _CAPTION)]


def _traces_of(run: RunRecord, name: str) -> dict[str, Trace]:
    return {run.whose(origin): run.traces[origin, name] for origin in ORIGINS if (origin, name) in run.traces}


def _windows(run: RunRecord, cycle: Cycle | None) -> list[_Window]:
    """Wave by wave, two twins can be held against a run only from rest on."""
    if cycle is None:
        return [_first_impacts(run), _one_cycle(run)]
    return [_first_impacts(run) if cycle.from_rest else _one_cycle(run)]


def _draw_window(grid: PlotGrid, row: int, column: int, shown: _Shown, window: _Window, points: int) -> None:
    cell = _COLUMNS * row + column
    time = {"title": {"text": f"ms after {window.start_s:.4f} s"}}
    grid.axes(cell, f"{shown.title}, {window.title}", time, {}, share_x_with=column)
    for whose, trace in shown.traces.items():
        times, values = trace.window(window.start_s, window.end_s)
        chosen = envelope(values, points)
        moments = 1e3 * (times[chosen.indices] - window.start_s)
        grid.line(cell, whose, moments, chosen.values, shown.channel)


def _draw_mean(grid: PlotGrid, row: int, shown: _Shown, cycle: Cycle) -> None:
    cell = _COLUMNS * row + 1
    share = {"title": {"text": "share of a cycle"}, "range": [0, 1]}
    grid.axes(cell, f"{shown.title}, mean of all cycles", share, {})
    for whose, trace in shown.traces.items():
        grid.line(cell, whose, *mean_cycle(trace, cycle), shown.channel)


def _remarks(run: RunRecord, cycle: Cycle | None) -> list[Sentence]:
    if cycle is not None:
        return [Sentence(f"{_FROM_REST if cycle.from_rest else _RUNNING} {_MEAN}")]
    if all(run.contact_forces(origin) is None for origin in ORIGINS):
        return [Sentence("No contact forces in this run: the left column shows its beginning.")]
    if _first_contacts(run) is None:
        return [Sentence("No impact in this run: the left column shows its beginning.")]
    return []


def _first_contacts(run: RunRecord) -> NDArray[np.float64] | None:
    """Start and end in s of the first contacts, shape (m, 2): the measured, or the predicted if none is."""
    for origin in ORIGINS:
        forces = run.contact_forces(origin)
        if forces is None:
            continue
        top = largest_force(*(force.values for force in forces))
        found = [find_impacts(force.values, force.sample_rate, top) for force in forces]
        bounds = np.vstack([np.column_stack((each.start, each.end)) for each in found])
        bounds = bounds[bounds[:, 0] > 0]  # a contact that the record's start cuts shows nothing
        if len(bounds):
            ordered: NDArray[np.float64] = bounds[np.argsort(bounds[:, 0])] / forces[0].sample_rate
            return ordered[:_CONTACTS_SHOWN]
    return None


def _first_impacts(run: RunRecord) -> _Window:
    contacts = _first_contacts(run)
    if contacts is None:
        return _Window("the beginning", 0.0, _WITHOUT_IMPACTS_S)
    start, end = float(contacts[0, 0]), float(contacts[-1, 1])
    return _Window("first impacts", max(start - _BEFORE_S, 0.0), end + _AFTER_S)


def _one_cycle(run: RunRecord) -> _Window:
    duration = max(len(trace.values) / trace.sample_rate for trace in run.traces.values())
    cycle = scenario_facts(run.scenario).cycle_s
    if cycle is None:
        return _Window("the first second", 0.0, min(1.0, duration))
    if duration < cycle:
        return _Window("the whole run", 0.0, duration)
    start = (duration - cycle) / 2  # the middle of the run: away from the start's transients
    return _Window("one drive cycle", start, start + cycle)
