"""What the points of a sweep came to: a table for other programs, and a page with impacts and peaks."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.disk import write_whole
from rig.derived.settings import has_figures
from rig.files.sweep import Point, Sweep
from rig.files.sweep_axes import Axis, numbers_of
from rig.pages.content import Figure, Link, Part, Sentence, Table, page
from rig.pages.plots import BLUE, FROM_ZERO, ORANGE, Plots, Style
from rig.pages.words import as_written, spread
from rig.rigs import RIGS
from rig.sweep.figures import (
    A_CYCLE,
    FIRST_MEAN,
    FIRST_SD,
    HELD,
    IMPACTS,
    LARGEST,
    NEAR_DEG,
    PEAK_MEAN,
    PEAK_SD,
    RMS,
    SMALLEST,
    WHOSE,
    channels_with,
    figure_of,
    impacts_in,
)
from rig.sweep.state import PointState, SweepState

if TYPE_CHECKING:
    from rig.live.view import Swept

TABLE: Final = "points.csv"


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


class Curve(NamedTuple):
    """A figure over the swept value, measured and predicted: its name, and that of its scatter."""

    figure: str
    scatter: str = ""
    dash: str = "solid"


class Cell(NamedTuple):
    """What is plotted together over the swept value, `factor` times as large as the figures are."""

    title: str
    curves: tuple[Curve, ...]
    factor: float = 1.0


_IMPACT_PEAKS: Final = (
    ("initial peak", Curve(FIRST_MEAN, FIRST_SD)),
    ("largest peak", Curve(PEAK_MEAN, PEAK_SD)),
)
"""Of an impact with its bounces."""


def _impact_peaks(sweep: Sweep) -> list[Cell]:
    unit = as_written(_unit_of(sweep))[1]
    return [Cell(f"{what}, {unit}", (curve,)) for what, curve in _IMPACT_PEAKS]


def _peaks(channel: str, unit: str) -> Cell:
    """The two lines of the source's figure 17 (Deck and Dubowsky), section 4D; of a beam the upper alone."""
    factor, written = as_written(unit)
    largest, smallest = (figure_of(channel, what, unit) for what in (LARGEST, SMALLEST))
    return Cell(f"{channel} peaks, {written}", (Curve(largest), Curve(smallest, dash="dash")), factor)


def _rms(channel: str, unit: str) -> Cell:
    factor, written = as_written(unit)
    return Cell(f"{channel} rms, {written}", (Curve(figure_of(channel, RMS, unit)),), factor)


PAGE: Final = "sweep.html"
_ROW_PX: Final = 240
_COLUMNS: Final = 2
_STYLES: Final = {
    "measured": Style(BLUE, 1.6, "lines+markers", size=7),
    "predicted": Style(ORANGE, 1, "lines+markers", size=4),
}
_BARS: Final = "Bars: standard deviation of the peaks."
_DASHED: Final = (
    "Peaks: the largest of all cycles; dashed, the smallest of the others within "
    f"{NEAR_DEG:g} degrees of its angle."
)
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
    names = dict.fromkeys(name for point in state.points.values() for name in point.figures)
    impacts = [Cell("impacts a cycle", (Curve(A_CYCLE),)), *_impact_peaks(sweep)]
    counted: Part = Sentence(_NO_IMPACTS)
    if A_CYCLE in names:
        counted = _figure("sweep", sweep, state, impacts, columns=len(impacts))
    channels = list(_channel_cells(names))
    sections: list[tuple[str, list[Part]]] = [
        ("Impacts over the swept value", [counted]),
        ("Channels over the swept value", [_figure("channels", sweep, state, channels)] if channels else []),
        ("Points", [Table(headings_of(sweep), rows, _ENDED, words=True)]),
    ]
    write_whole(folder / PAGE, page(sweep.name, subtitle, sections).encode())
    return folder / PAGE


def _channel_cells(names: Iterable[str]) -> Iterator[Cell]:
    """Of each channel what there are figures of."""
    for what, cell in ((LARGEST, _peaks), (RMS, _rms)):
        for channel, unit in channels_with(what, names).items():
            if has_figures(channel):
                yield cell(channel, unit)


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
            peaks = (_both(ended, curve, unit) for _, curve in _IMPACT_PEAKS)
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


def _both(ended: PointState, curve: Curve, unit: str) -> str:
    """What was measured and what was predicted, each with its scatter."""
    told = [
        spread(ended.figures[whose + curve.figure], ended.figures[whose + curve.scatter], unit)
        for _, whose in WHOSE
        if whose + curve.figure in ended.figures
    ]
    *first, last = told or [""]  # the unit is said once
    return " / ".join([*(each.removesuffix(f" {as_written(unit)[1]}") for each in first), last])


def _unit_of(sweep: Sweep) -> str:
    channels = RIGS[sweep.rig].channels
    heard = [*RIGS[sweep.rig].contacts, *itertools.chain(*channels.heard(channels.told).values())]
    return (channels.unit(heard[0]) if heard else None) or ""


def headings_of(sweep: Sweep) -> list[str]:
    """The headings of `rows_of`."""
    peaks = [f"{what} / predicted" for what, _ in _IMPACT_PEAKS]
    return ["point", *(axis.key for axis in sweep.axes), "outcome", "impacts", *peaks, "drive held", "log"]


def swept_so_far(sweep: Sweep, state: SweepState, point: Point) -> Swept | None:
    """What the points with the same other settings as this one came to; None where there is none yet.

    Peaks of the impacts, then peaks and rms of the channel that shows the largest of those with impacts.
    """
    from rig.live.view import Swept  # what nobody watches need not load Rerun

    swept, numbers, unit = _swept_axis(sweep)
    others = [axis.key for axis in sweep.axes if axis is not swept]
    row = [each for each in sweep.points if all(each.settings[key] == point.settings[key] for key in others)]
    figures = [state.points[each.number].figures if each.number in state.points else {} for each in row]
    if not any(A_CYCLE in each for each in figures):
        return None
    low, high = min(numbers), max(numbers)
    at = [(each - low) / (high - low or 1.0) for each in np.resize(np.array(numbers), len(row)).tolist()]

    def largest(told: tuple[str, str]) -> float:
        return max(each.get(figure_of(told[0], LARGEST, told[1]), 0.0) for each in figures)

    cells, shown = _impact_peaks(sweep), channels_with(LARGEST, itertools.chain(*figures)).items()
    if seen := [each for each in shown if impacts_in(each[0])]:
        strongest = max(seen, key=largest)
        cells += [_peaks(*strongest), _rms(*strongest)]
    ends = f"{low:g} {unit}".rstrip(), f"{high:g} {unit}".rstrip()
    return Swept(
        swept.key,
        ends,
        at,
        {
            cell.title: {origin: [_point(each, cell, whose) for each in figures] for origin, whose in WHOSE}
            for cell in cells
        },
    )


def _point(figures: Mapping[str, float], cell: Cell, whose: str) -> tuple[float, ...] | None:
    """The ends of a bar over all of a cell with its scatter, then what is marked on it."""
    curves = [curve for curve in cell.curves if whose + curve.figure in figures]
    if not curves:
        return None
    marks = [cell.factor * figures[whose + curve.figure] for curve in curves]
    reach = [cell.factor * figures.get(whose + curve.scatter, 0.0) for curve in curves]
    low = min(mark - each for mark, each in zip(marks, reach, strict=True))
    high = max(mark + each for mark, each in zip(marks, reach, strict=True))
    return low, high, *marks


def _swept_axis(sweep: Sweep) -> tuple[Axis, list[float], str]:
    """The last axis that takes several values; they as numbers, counted where they are none, and the unit."""
    swept = next((axis for axis in reversed(sweep.axes) if len(axis.values) > 1), sweep.axes[-1])
    numbers, unit = numbers_of(swept) or (list(map(float, range(len(swept.values)))), "")
    return swept, numbers, unit


def _figure(
    name: str, sweep: Sweep, state: SweepState, cells: Sequence[Cell], columns: int = _COLUMNS
) -> Figure:
    """The cells in rows for each setting of the other axes, the last one with several values along x."""
    swept, numbers, of = _swept_axis(sweep)
    ticks = dict[str, Any]()
    if numbers_of(swept) is None:  # values that are no numbers stand side by side
        ticks = {"tickvals": list(range(len(swept.values))), "ticktext": [str(each) for each in swept.values]}
    label = f"{swept.key}, {of}".rstrip(", ")
    settings: dict[str, list[Point]] = {}
    for point in sweep.points:
        others = (f"{axis.key} {point.settings[axis.key]}" for axis in sweep.axes if axis is not swept)
        settings.setdefault(", ".join(others), []).append(point)
    rows, whole = -(-len(cells) // columns), len(swept.values)
    grid, remarks = Plots(rows * len(settings), columns, _ROW_PX), dict[str, None]()
    for block, (setting, points) in enumerate(settings.items()):
        ended = [state.points.get(point.number) for point in points]
        figures = [{} if each is None else each.figures for each in ended]
        symbols = [  # hollow on the way back of an axis that goes there and back
            "circle-open" if swept.both_ways and 2 * (index % whole) >= whole else "circle"
            for index in range(len(points))
        ]
        x = np.resize(np.array(numbers, np.float64), len(points))
        texts = [f"point {point.number}" for point in points]
        for place, cell in enumerate(cells, block * rows * columns):
            title = f"{cell.title}  {setting}".rstrip()
            grid.axes(place, title, label, x_axis=ticks, y_axis=FROM_ZERO)
            _draw(grid, place, cell, figures, x, symbols, texts)
        if any(each is not None and symbol != "circle" for each, symbol in zip(ended, symbols, strict=True)):
            remarks[_WAY_BACK] = None
        drawn = [curve for cell in cells for curve in cell.curves]
        if any(curve.scatter in each for curve in drawn for each in figures):
            remarks[_BARS] = None
        if any(curve.dash != "solid" and curve.figure in each for curve in drawn for each in figures):
            remarks[_DASHED] = None
    return grid.figure(name, " ".join(remarks))


def _draw(
    grid: Plots,
    place: int,
    cell: Cell,
    figures: Sequence[Mapping[str, float]],
    x: NDArray[np.float64],
    symbols: Sequence[str],
    texts: Sequence[str],
) -> None:
    """Draw what the points at `x`, (n,), came to; the symbol and the text of each."""
    for curve in cell.curves:
        for name, whose in WHOSE:
            values, deviations = (
                [cell.factor * each.get(whose + key, nan) for each in figures]
                for key in (curve.figure, curve.scatter)
            )
            if not whose or np.isfinite(values).any():
                style = replace(_STYLES[name], dash=curve.dash, symbol=symbols)
                grid.line(
                    place,
                    name,
                    x,
                    values,
                    style,
                    deviations=deviations if curve.scatter else None,
                    texts=texts,
                )
