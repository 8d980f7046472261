"""What the points of a sweep came to: a table for other programs, and a page with impacts and peaks."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from daq.disk import write_whole
from daq.log.reader import Origin
from rig.files.scenario import Scenario
from rig.files.sweep import Point, Sweep
from rig.files.sweep_axes import Axis, numbers_of
from rig.pages.content import Link, Part, Sentence, Table, page
from rig.pages.plots import BLUE, FROM_ZERO, ORANGE, Plots, Style
from rig.pages.words import as_written, spread
from rig.report.record import RunRecord, read_run
from rig.report.summary import half_cycle_statistics
from rig.rigs import RIGS
from rig.session.frequency import OFF, UNKNOWN, FrequencyCheck
from rig.sweep.state import PointState, SweepState

if TYPE_CHECKING:
    from rig.live.view import Swept

TABLE: Final = "points.csv"

HELD: Final = ("drive held [Hz]", "speed held [rpm]")
IMPACTS: Final = "impacts recorded"
A_CYCLE: Final = "impacts a cycle"
FIRST_MEAN, FIRST_SD = "impact initial peak mean", "impact initial peak sd"
PEAK_MEAN, PEAK_SD = "impact peak mean", "impact peak sd"
PREDICTED: Final = "predicted "
"""Begins the names of these where they are the twin's."""
_SHOWN: Final = (("initial peak", FIRST_MEAN, FIRST_SD), ("largest peak", PEAK_MEAN, PEAK_SD))
"""Of an impact with its bounces."""
_WHOSE: Final[tuple[tuple[Origin, str], ...]] = (("measured", ""), ("predicted", PREDICTED))
_FAILS = {OFF, UNKNOWN, "drive.not_seen", "motor.off_speed", "motor.limit"}
"""Codes of events that say of a complete record that its drive was not as asked for."""


def outcome_of(log: Path, scenario: Scenario) -> tuple[str, dict[str, float]]:
    """Read a point's complete log once: why it is not what the sweep asked for, or nothing, and its figures.

    Those by names that hold the unit, none that is not finite: what the drive was held to, impacts on the
    rig's contact forces (elsewhere on the channel that shows most of them) with their initial and largest
    peaks in its unit, statistics of the peaks of half cycles where it has contact forces, both measured and
    predicted, then rms and peak of each channel.
    """
    held = RIGS[scenario.rig].held_sine(scenario.drive)
    check = None if held is None else FrequencyCheck(*held)
    run = read_run(log, [] if check is None else [check])
    figures: dict[str, float] = {}
    if check is not None:
        figures[HELD[0]] = check.result().measured
    elif (speed := run.speeds.get("measured")) is not None and np.isfinite(speed.values).any():
        figures[HELD[1]] = float(speed.values[np.isfinite(speed.values)].astype(np.float64).mean())
    figures |= _impacts(run, scenario)
    for origin, whose in _WHOSE:
        if (statistics := half_cycle_statistics(run, origin)) is not None:
            peaks = dataclasses.asdict(statistics)
            peaks = {"half_cycles": peaks.pop("count"), **peaks}
            figures |= {whose + name: value for name, value in peaks.items()}
    for name, tally in run.measured.items():
        unit = run.channels[name].unit
        figures |= {f"{name} rms [{unit}]": tally.rms, f"{name} peak [{unit}]": tally.peak}
    why = "; ".join(event.text for event in run.events if event.code in _FAILS)
    return why, {name: float(value) for name, value in figures.items() if math.isfinite(value)}


def _impacts(run: RunRecord, scenario: Scenario) -> dict[str, float]:
    """As measured, and as predicted where there is a prediction."""
    on = RIGS[scenario.rig].contacts
    if not on:
        seen = (impact.channel for impact in run.impacts if impact.origin == "measured")
        on = tuple(channel for channel, _ in Counter(seen).most_common(1))
    cycles = run.duration_s * scenario.drive.cycle_hz or math.nan
    found: dict[str, float] = {}
    for origin, whose in _WHOSE:
        if not any((origin, channel) in run.traces for channel in on):
            continue
        at = [impact for impact in run.impacts if impact.origin == origin and impact.channel in on]
        found |= {whose + A_CYCLE: len(at) / cycles} | ({} if whose else {IMPACTS: len(at)})
        peaks = ([each.first_peak for each in at], [each.peak for each in at])
        for (_, mean, deviation), values in zip(_SHOWN, peaks, strict=True):
            if at:
                found |= {whose + mean: float(np.mean(values)), whose + deviation: float(np.std(values))}
    return found


def impacts_recorded(ended: PointState) -> int | None:
    """How many impacts a point's record holds, wherever they are told; None where nobody looked for them."""
    return round(ended.figures[IMPACTS]) if IMPACTS in ended.figures else None


def write_results(folder: Path, sweep: Sweep, state: SweepState) -> Path:
    """Write one row for each point that has ended; returns the table's path."""
    found = dict.fromkeys(name for point in state.points.values() for name in point.figures)
    names = [name for name in found if name != IMPACTS]
    keys = [axis.key for axis in sweep.axes]
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["point", *keys, "outcome", "impacts", *names, "log"])
    for point in sweep.points:
        ended = state.points.get(point.number)
        if ended is not None:
            figures = [f"{ended.figures[name]:.9g}" if name in ended.figures else "" for name in names]
            values = [point.settings[key] for key in keys]
            impacts = impacts_recorded(ended)
            rows.writerow([point.number, *values, ended.outcome, impacts, *figures, ended.log or ""])
    write_whole(folder / TABLE, text.getvalue().encode())
    return folder / TABLE


def points_of(folder: Path, sweep: Sweep, state: SweepState) -> list[dict[str, Any]]:
    """Each point that has ended, for a program: its settings, how it ended, its log and its figures.

    `impacts` is how many its record holds, as in the table; `counted` how many were over when they ended it.
    """
    ended = ((point, state.points.get(point.number)) for point in sweep.points)
    return [
        {
            "point": point.number,
            "settings": dict(point.settings),
            "outcome": each.outcome,
            "why": each.why,
            "log": each.log and str(folder / each.log),
            "impacts": impacts_recorded(each),
            "counted": each.impacts,
            "figures": {name: value for name, value in each.figures.items() if name != IMPACTS},
        }
        for point, each in ended
        if each is not None
    ]


PAGE: Final = "sweep.html"
_ROW_PX: Final = 240
_BARS: Final = "Bars: standard deviation of the peaks."
_WAY_BACK: Final = "Hollow: on the way back; the drive came there through all values before, without a rest."
_ENDED: Final = "Points that have ended"
_NO_IMPACTS: Final = "No record of this sweep says how many impacts it holds."


def write_page(folder: Path, sweep: Sweep, state: SweepState) -> Path:
    """Write the page beside the logs; returns its path, raises RecorderFailed."""
    done = state.ended("done")
    subtitle = [sweep.rig.replace("_", " "), f"{len(done)} of {len(sweep.points)} points done"]
    rows = [
        [*words, Link(log.partition("/")[0], log) if log else ""]  # the name of its folder says which
        for *words, log in rows_of(sweep, state)
    ]
    sections: list[tuple[str, list[Part]]] = [
        ("Impacts over the swept value", [_figure(sweep, state)]),
        ("Points", [Table(headings_of(sweep), rows, _ENDED, words=True)]),
    ]
    write_whole(folder / PAGE, page(sweep.name, subtitle, sections).encode())
    return folder / PAGE


def rows_of(sweep: Sweep, state: SweepState) -> Iterator[list[str]]:
    """Each point that has ended: number, settings, outcome, impacts, their peaks, what its drive was held to,
    log."""
    unit = _unit_of(sweep)
    for point in sweep.points:
        ended = state.points.get(point.number)
        if ended is not None:
            settings = (str(point.settings[axis.key]) for axis in sweep.axes)
            impacts = impacts_recorded(ended)
            said = (  # with the unit, which stands in brackets in the figure's name
                f"{ended.figures[name]:.7g} {name.partition('[')[2].rstrip(']')}"
                for name in HELD
                if name in ended.figures
            )
            peaks = (_both(ended, mean, deviation, unit) for _, mean, deviation in _SHOWN)
            held, log = next(said, ""), ended.log or ""
            yield [
                str(point.number),
                *settings,
                ended.outcome,
                "" if impacts is None else str(impacts),
                *peaks,
                held,
                log,
            ]


def _both(ended: PointState, mean: str, deviation: str, unit: str) -> str:
    """What was measured and what was predicted, each with its scatter."""
    told = [
        spread(ended.figures[whose + mean], ended.figures[whose + deviation], unit)
        for _, whose in _WHOSE
        if whose + mean in ended.figures
    ]
    *first, last = told or [""]  # the unit is said once
    return " / ".join([*(each.removesuffix(f" {as_written(unit)[1]}") for each in first), last])


def _unit_of(sweep: Sweep) -> str:
    channels = RIGS[sweep.rig].channels
    heard = [*RIGS[sweep.rig].contacts, *itertools.chain(*channels.heard(channels.told).values())]
    return (channels.unit(heard[0]) if heard else None) or ""


def headings_of(sweep: Sweep) -> list[str]:
    """The headings of `rows_of`."""
    peaks = [f"{what} / predicted" for what, *_ in _SHOWN]
    return ["point", *(axis.key for axis in sweep.axes), "outcome", "impacts", *peaks, "drive held", "log"]


def swept_so_far(sweep: Sweep, state: SweepState, point: Point) -> Swept | None:
    """What the points with the same other settings as this one came to; None where there is none yet."""
    from rig.live.view import Swept  # what nobody watches need not load Rerun

    swept, numbers, unit = _swept_axis(sweep)
    others = [axis.key for axis in sweep.axes if axis is not swept]
    row = [each for each in sweep.points if all(each.settings[key] == point.settings[key] for key in others)]
    figures = [state.points[each.number].figures if each.number in state.points else {} for each in row]
    if not any(A_CYCLE in each for each in figures):
        return None
    low, high = min(numbers), max(numbers)
    at = [(each - low) / (high - low or 1.0) for each in np.resize(np.array(numbers), len(row)).tolist()]
    shown = as_written(_unit_of(sweep))[1]

    def both(names: Sequence[str]) -> dict[str, list[tuple[float, float] | None]]:
        return {
            origin: [
                (each[whose + names[0]], each[whose + names[1]]) if whose + names[0] in each else None
                for each in figures
            ]
            for origin, whose in _WHOSE
        }

    ends = f"{low:g} {unit}".rstrip(), f"{high:g} {unit}".rstrip()
    plots = {f"{what}, {shown}": both(names) for what, *names in _SHOWN}
    return Swept(swept.key, ends, at, plots)


def _swept_axis(sweep: Sweep) -> tuple[Axis, list[float], str]:
    """The last axis that takes several values; they as numbers, counted where they are none, and the unit."""
    swept = next((axis for axis in reversed(sweep.axes) if len(axis.values) > 1), sweep.axes[-1])
    numbers, unit = numbers_of(swept) or (list(map(float, range(len(swept.values)))), "")
    return swept, numbers, unit


def _figure(sweep: Sweep, state: SweepState) -> Part:
    """A row for each setting of the other axes, with the last one that takes several values along x."""
    if not any(A_CYCLE in ended.figures for ended in state.points.values()):
        return Sentence(_NO_IMPACTS)
    swept, numbers, of = _swept_axis(sweep)
    unit = as_written(_unit_of(sweep))[1]
    columns = (("impacts a cycle", A_CYCLE, ""), *((f"{what}, {unit}", *names) for what, *names in _SHOWN))
    ticks = dict[str, Any]()
    if numbers_of(swept) is None:  # values that are no numbers stand side by side
        ticks = {"tickvals": list(range(len(swept.values))), "ticktext": [str(each) for each in swept.values]}
    label = f"{swept.key}, {of}".rstrip(", ")
    rows: dict[str, list[Point]] = {}
    for point in sweep.points:
        others = (f"{axis.key} {point.settings[axis.key]}" for axis in sweep.axes if axis is not swept)
        rows.setdefault(", ".join(others), []).append(point)
    grid, remarks = Plots(rows=len(rows), columns=len(columns), row_px=_ROW_PX), dict[str, None]()
    for row, (setting, points) in enumerate(rows.items()):
        ended = [state.points.get(point.number) for point in points]
        figures = [{} if each is None else each.figures for each in ended]
        whole = len(swept.values)
        symbols = [  # hollow on the way back of an axis that goes there and back
            "circle-open" if swept.both_ways and 2 * (index % whole) >= whole else "circle"
            for index in range(len(points))
        ]
        styles = {
            "measured": Style(BLUE, 1.6, "lines+markers", symbol=symbols, size=7),
            "predicted": Style(ORANGE, 1, "lines+markers", symbol=symbols, size=4),
        }
        texts = [f"point {point.number}" for point in points]
        for column, (title, *names) in enumerate(columns):
            cell = len(columns) * row + column
            grid.axes(cell, f"{title}  {setting}".rstrip(), label, x_axis=ticks, y_axis=FROM_ZERO)
            x = np.resize(np.array(numbers, np.float64), len(points))
            for name, style in styles.items():
                whose = PREDICTED if name == "predicted" else ""
                keys = [whose + key if key else "" for key in names]
                values, deviations = ([each.get(key, nan) for each in figures] for key in keys)
                if not whose or np.isfinite(values).any():
                    grid.line(cell, name, x, values, style, deviations=deviations, texts=texts)
        if any(each is not None and symbol != "circle" for each, symbol in zip(ended, symbols, strict=True)):
            remarks[_WAY_BACK] = None
        if any(PEAK_SD in each for each in figures):
            remarks[_BARS] = None
    return grid.figure("sweep", " ".join(remarks))
