"""All of a run over time, by its extremes, with what happened and what was not to be passed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from daq.block import NS_PER_S
from daq.errors import ConfigurationError
from daq.signals.envelope import stretch_of
from rig.files.scenario import Limit, parse_scenario
from rig.pages.content import Part, Sentence
from rig.pages.plots import Plots, points_each
from rig.pages.words import as_written, number
from rig.report.record import ORIGINS, RunRecord

_ROW_PX = 90
_DRAWN_UP_TO = 2.0
"""Of the largest magnitude: a limit farther off would leave nothing else to be seen."""
_MARKS, _MOST_MARKED = 2500, 500
"""In all plots together, and events of them at most, as many as the table tells: each has its words in it."""
_WORST = {"error": 0, "warning": 1}


def parts(run: RunRecord) -> list[Part]:
    """A plot for each channel but angles that grow as long as the run lasts."""
    names = [
        name
        for name in run.channels
        if name not in run.roles.unwrapped and any((origin, name) in run.traces for origin in ORIGINS)
    ]
    if not names:
        return []
    limits, points = list(_limits(run)), points_each(len(run.traces))
    end_s = max(trace.end_s for trace in run.traces.values())
    events = list(_events(run, end_s))
    marked = sorted(events, key=lambda each: each[0])[: min(_MARKS // len(names), _MOST_MARKED)]
    plots = Plots(rows=len(names), columns=1, row_px=_ROW_PX)
    for row, name in enumerate(names):
        factor, unit = as_written(run.channels[name].unit)
        below = "s of the record" if row == len(names) - 1 else ""
        plots.axes(row, f"{name} [{unit or '-'}]", below, share_x_with=0)
        low, high = _drawn(plots, row, run, name, points)
        for level in _levels(limits, name):
            if low <= high and factor * level <= _DRAWN_UP_TO * max(-low, high):
                for line in (factor * level, -factor * level):
                    plots.line(row, "limit", [0.0, end_s], [line, line], texts=[number(line, unit)] * 2)
        if low <= high and marked:
            _mark(plots, row, marked, low, high)
    told = [
        f"{limit.channel} {number(level, limit.unit)}"
        for limit in limits
        for level in (limit.warning, limit.abort)
        if level is not None
    ]
    said = [f"Limits of this run: {', '.join(told)}."] if told else []
    if run.kept_s is not None:
        said.append(f"Drawn are the first {run.kept_s:.0f} s of the run only.")
    if len(marked) < len(events):
        said.append(
            f"Marked are {len(marked)} of {len(events)} events, the worst first; the table below has more."
        )
    return [*map(Sentence, said), plots.figure("whole-run", _caption(run, points))]


def _drawn(plots: Plots, row: int, run: RunRecord, name: str, points: int) -> tuple[float, float]:
    """Draw what there is of a channel; returns the least and the largest value."""
    low, high = np.inf, -np.inf
    for origin in ORIGINS:
        if (origin, name) in run.traces:
            trace = run.written(origin, name)
            times, values = trace.window(0.0, trace.end_s)
            plots.outline(row, run.whose(origin), times, values, subject=name, points=points)
            known = values[np.isfinite(values)]
            low, high = min(low, known.min(initial=np.inf)), max(high, known.max(initial=-np.inf))
    return low, high


def _mark(plots: Plots, row: int, events: Sequence[tuple[int, float, str]], low: float, high: float) -> None:
    """One line for all events: Plotly is slow with many."""
    times = np.array([time_s for _, time_s, _ in events])
    x = np.stack((times, times, np.full(len(times), np.nan)), axis=1).ravel()
    y = np.tile([low, high, np.nan], len(times))
    plots.line(row, "event", x, y, texts=[part for *_, text in events for part in (text, text, "")])


def _caption(run: RunRecord, points: int) -> str:
    stretches_s = [
        stretch_of(len(trace.values), points) / trace.sample_rate
        for trace in run.traces.values()
        if len(trace.values) > points
    ]
    drawn = "every sample."
    if stretches_s:
        drawn = (
            f"the smallest and the largest sample in stretches of {1e3 * max(stretches_s):.2g} ms, within "
            "which no zoom tells anything apart: rattle.open(LOG).plot(start=..., end=...) does."
        )
    return (
        f"Drag to zoom, double-click to go back. Every line is drawn by {drawn} Predictions lie on top. "
        "Point at an event for what it says."
    )


def _limits(run: RunRecord) -> Iterator[Limit]:
    try:
        yield from parse_scenario(run.scenario).limits
    except ConfigurationError:
        return


def _levels(limits: list[Limit], name: str) -> Iterator[float]:
    for limit in limits:
        if limit.channel == name:
            yield from (level for level in (limit.warning, limit.abort) if level is not None)


def _events(run: RunRecord, end_s: float) -> Iterator[tuple[int, float, str]]:
    """How little bad each is, when it was (s of the record), and what it says."""
    for event in run.events:
        time_s = 0.0 if run.begins_ns is None else (event.time_ns - run.begins_ns) / NS_PER_S
        if 0.0 < time_s < end_s:
            yield _WORST.get(event.level, len(_WORST)), time_s, f"{event.code}: {event.text}"
