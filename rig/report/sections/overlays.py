"""Measured over predicted in time: the first impacts, one cycle of the drive, and the mean of all cycles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.signals.impacts import find_impacts, largest_force
from rig.pages.content import Part, Sentence
from rig.pages.plots import Plots, points_each
from rig.report.record import ORIGINS, RunRecord, Trace

_CONTACTS_SHOWN = 4
_BEFORE_S, _AFTER_S = 0.001, 0.002
_WITHOUT_IMPACTS_S = 0.05
_ROW_PX = 150
_COLUMNS = 2
_MEAN_POINTS = 400

_CAPTION = "Drag to zoom, double-click to go back. The time axes of a column move together."
_FROM_REST = (
    "The drive began in this run: the first impacts may be compared wave by wave, later ones may not."
)
_RUNNING = (
    "The drive was running before this run, so that no single wave of a twin has to meet the measured one."
)
_MEAN = "The mean of all cycles may be compared as it stands, and so may the distributions and spectra below."


class Cycle(NamedTuple):
    """The drive's cycle or the crank's revolution: frequency in Hz, phase at sample 0 in rad.

    `from_rest` is True where the drive began within the record.
    """

    frequency_hz: float
    phase_rad: float
    from_rest: bool


def cycle_of(run: RunRecord) -> Cycle | None:
    """The cycle that an overlay notes in its log; None where it does not, or where it makes no sense."""
    record = run.metadata.get("twin", {})
    try:
        frequency_hz, phase_rad = float(record["cycle_hz"]), float(record["cycle_phase_rad"])
    except (KeyError, ValueError):
        return None
    if not (math.isfinite(phase_rad) and 0 < frequency_hz < math.inf):
        return None
    return Cycle(frequency_hz, phase_rad, record.get("from_rest") == "true")


def mean_cycle(trace: Trace, cycle: Cycle) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shares of a cycle and the mean of all finite samples there, both of shape (m,); empty without one."""
    finite = np.flatnonzero(np.isfinite(trace.values))
    turns = finite * (cycle.frequency_hz / trace.sample_rate) + cycle.phase_rad / (2 * np.pi)
    count = max(1, min(_MEAN_POINTS, round(trace.sample_rate / cycle.frequency_hz)))
    place = np.minimum((turns % 1.0 * count).astype(np.int64), count - 1)
    seen = np.bincount(place, minlength=count)
    total = np.bincount(place, trace.values[finite].astype(np.float64), count)
    filled = seen > 0
    return (np.flatnonzero(filled) + 0.5) / count, total[filled] / seen[filled]


class _Window(NamedTuple):
    title: str
    start_s: float
    end_s: float


def parts(run: RunRecord) -> list[Part]:
    """A row of two plots for each channel; with two twins the second is the mean of all cycles.

    Nothing for a rig with a shaft, whose channels are shown over its angle.
    """
    if run.roles.turns:
        return []
    if not run.traces:
        return [Sentence("The log holds no samples.")]
    cycle = cycle_of(run)
    contacts = _first_contacts(run)
    windows = [_first_impacts(contacts), _one_cycle(run)]
    if cycle is not None:  # wave by wave, two twins can be held against a run only from rest on
        windows = windows[:1] if cycle.from_rest else windows[1:]
    plots = Plots(rows=len(run.channels), columns=_COLUMNS, row_px=_ROW_PX)
    points = points_each(len(run.traces) * _COLUMNS)
    for row, (name, channel) in enumerate(run.channels.items()):
        title, left = f"{name} [{channel.unit or '-'}]", _COLUMNS * row
        traces = {
            run.whose(origin): run.traces[origin, name] for origin in ORIGINS if (origin, name) in run.traces
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
                plots.line(left + 1, whose, *mean_cycle(trace, cycle), subject=name)
    return [*_remark(run, cycle, contacts is not None), plots.figure("overlays", _CAPTION)]


def _remark(run: RunRecord, cycle: Cycle | None, impacts: bool) -> list[Sentence]:
    if cycle is not None:
        return [Sentence(f"{_FROM_REST if cycle.from_rest else _RUNNING} {_MEAN}")]
    if impacts:
        return []
    forces = any(run.contact_forces(origin) is not None for origin in ORIGINS)
    what = "impact" if forces else "contact forces"
    return [Sentence(f"No {what} in this run: the left column shows its beginning.")]


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


def _first_impacts(contacts: NDArray[np.float64] | None) -> _Window:
    if contacts is None:
        return _Window("the beginning", 0.0, _WITHOUT_IMPACTS_S)
    start, end = float(contacts[0, 0]), float(contacts[-1, 1])
    return _Window("first impacts", max(start - _BEFORE_S, 0.0), end + _AFTER_S)


def _one_cycle(run: RunRecord) -> _Window:
    duration = max(len(trace.values) / trace.sample_rate for trace in run.traces.values())
    cycle = run.facts.cycle_s
    if cycle is None:
        return _Window("the first second", 0.0, min(1.0, duration))
    if duration < cycle:
        return _Window("the whole run", 0.0, duration)
    start = (duration - cycle) / 2  # the middle of the run: away from the start's transients
    return _Window("one drive cycle", start, start + cycle)
