"""All of a run over time, by its extremes, with what happened and what was not to be passed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from daq.block import NS_PER_S
from daq.errors import ConfigurationError
from rig.files.scenario import Limit, parse_scenario
from rig.pages.content import Part, Sentence
from rig.pages.plots import Plots, points_each
from rig.pages.words import as_written, number
from rig.report.record import ORIGINS, RunRecord

_ROW_PX = 90
_CAPTION = (
    "Drag to zoom, double-click to go back. Every line is drawn by the smallest and the largest of each "
    "short stretch; predictions lie on top. Point at an event for what it says."
)
_DRAWN_UP_TO = 2.0
"""Of the largest magnitude: a limit farther off would leave nothing else to be seen."""


def parts(run: RunRecord) -> list[Part]:
    """A plot for each channel but angles that grow as long as the run lasts."""
    names = [
        name
        for name in run.channels
        if name not in run.roles.unwrapped and any((origin, name) in run.traces for origin in ORIGINS)
    ]
    if not names:
        return []
    limits = list(_limits(run))
    points = points_each(len(run.traces))
    plots = Plots(rows=len(names), columns=1, row_px=_ROW_PX)
    for row, name in enumerate(names):
        factor, unit = as_written(run.channels[name].unit)
        shown = {origin: run.written(origin, name) for origin in ORIGINS if (origin, name) in run.traces}
        below = "s of the record" if row == len(names) - 1 else ""
        plots.axes(row, f"{name} [{unit or '-'}]", below, share_x_with=0)
        low, high, end_s = np.inf, -np.inf, 0.0
        for origin, trace in shown.items():
            values = trace.values
            times = np.arange(len(values)) / trace.sample_rate
            plots.outline(row, run.whose(origin), times, values, subject=name, points=points)
            known = values[np.isfinite(values)]
            low, high = min(low, known.min(initial=np.inf)), max(high, known.max(initial=-np.inf))
            end_s = max(end_s, len(values) / trace.sample_rate)
        for level in _levels(limits, name):
            if low <= high and factor * level <= _DRAWN_UP_TO * max(-low, high):
                for line in (factor * level, -factor * level):
                    plots.line(row, "limit", [0.0, end_s], [line, line], texts=[number(line, unit)] * 2)
        for time_s, text in _events(run, end_s):
            if low <= high:
                plots.line(row, "event", [time_s, time_s], [low, high], texts=[text, text])
    told = [
        f"{limit.channel} {number(level, limit.unit)}"
        for limit in limits
        for level in (limit.warning, limit.abort)
        if level is not None
    ]
    said = [Sentence(f"Limits of this run: {', '.join(told)}.")] if told else []
    cut = [] if run.kept_s is None else [Sentence(f"Drawn are the first {run.kept_s:.0f} s of the run only.")]
    return [*said, *cut, plots.figure("whole-run", _CAPTION)]


def _limits(run: RunRecord) -> Iterator[Limit]:
    try:
        yield from parse_scenario(run.scenario).limits
    except ConfigurationError:
        return


def _levels(limits: list[Limit], name: str) -> Iterator[float]:
    for limit in limits:
        if limit.channel == name:
            yield from (level for level in (limit.warning, limit.abort) if level is not None)


def _events(run: RunRecord, end_s: float) -> Iterator[tuple[float, str]]:
    for event in run.events:
        time_s = 0.0 if run.begins_ns is None else (event.time_ns - run.begins_ns) / NS_PER_S
        if 0.0 < time_s < end_s:
            yield time_s, f"{event.code}: {event.text}"
