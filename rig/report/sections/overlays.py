"""Measured over predicted in time: the first impacts, and one cycle of the drive."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.log.reader import Origin
from daq.signals import envelope, find_impacts
from daq.signals.impacts import largest_force
from rig.report.content import Part, Sentence
from rig.report.plot import PlotGrid, points_each
from rig.report.record import ORIGINS, RunRecord, Trace
from rig.report.scenario_facts import scenario_facts

_CONTACTS_SHOWN = 4
_BEFORE_S, _AFTER_S = 0.001, 0.002
_WITHOUT_IMPACTS_S = 0.05
_ROW_PX = 150


class _Window(NamedTuple):
    title: str
    start_s: float
    end_s: float


def parts(run: RunRecord) -> list[Part]:
    """A row of two plots for each channel."""
    if not run.traces:
        return [Sentence("The log holds no samples.")]
    windows = _first_impacts(run), _one_cycle(run)
    grid = PlotGrid(rows=len(run.channels), columns=len(windows), row_px=_ROW_PX)
    points = points_each(len(run.traces) * len(windows))
    for row, (name, channel) in enumerate(run.channels.items()):
        for column, window in enumerate(windows):
            cell = row * len(windows) + column
            time = {"title": {"text": f"ms after {window.start_s:.4f} s"}}
            title = f"{name} [{channel.unit or '-'}], {window.title}"
            grid.axes(cell, title, time, {}, share_x_with=column)
            for origin in ORIGINS:
                if (trace := run.traces.get((origin, name))) is not None:
                    _draw(grid, cell, origin, trace, window, points, name)
    caption = "Drag to zoom, double-click to go back. The time axes of a column move together."
    return [*_remarks(run), grid.figure("overlays", caption)]


def _draw(
    grid: PlotGrid, cell: int, origin: Origin, trace: Trace, window: _Window, points: int, channel: str
) -> None:
    times, values = trace.window(window.start_s, window.end_s)
    chosen = envelope(values, points)
    grid.line(cell, origin, 1e3 * (times[chosen.indices] - window.start_s), chosen.values, channel)


def _remarks(run: RunRecord) -> list[Sentence]:
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
