"""What the points of a sweep came to, as a page: impacts and peaks over the swept value, and a table."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.files.sweep import Point, Sweep
from rig.files.sweep_axes import Axis, numbers_of
from rig.pages.content import Part, Sentence, Table
from rig.pages.page import page
from rig.pages.plots import BLUE, Plots, Style
from rig.rigs import RIGS
from rig.sweep.results import A_CYCLE, HELD, PEAK_MEAN, PEAK_SD, impacts_recorded
from rig.sweep.state import PointState, SweepState, write_whole

PAGE: Final = "sweep.html"
_ROW_PX: Final = 240
_CAPTION: Final = (
    "Bars: standard deviation of the peaks. Hollow: on the way back; the drive came there through all values "
    "before, without a rest."
)
_ENDED: Final = "Points that have ended"
_NO_IMPACTS: Final = "No record of this sweep says how many impacts it holds."


def write_page(folder: Path, sweep: Sweep, state: SweepState) -> Path:
    """Write the page beside the logs; returns its path, raises RecorderFailed."""
    done = state.ended("done")
    subtitle = [sweep.rig.replace("_", " "), f"{len(done)} of {len(sweep.points)} points done"]
    sections: list[tuple[str, list[Part]]] = [
        ("Impacts over the swept value", [_figure(sweep, state)]),
        ("Points", [Table(headings_of(sweep), list(rows_of(sweep, state)), _ENDED, words=True)]),
    ]
    write_whole(folder / PAGE, page(sweep.name, subtitle, sections).encode())
    return folder / PAGE


def rows_of(sweep: Sweep, state: SweepState) -> Iterator[list[str]]:
    """Each point that has ended: number, settings, outcome, impacts, what its drive was held to, log."""
    for point in sweep.points:
        ended = state.points.get(point.number)
        if ended is not None:
            settings = (str(point.settings[axis.key]) for axis in sweep.axes)
            counted = impacts_recorded(ended)
            yield [str(point.number), *settings, ended.outcome, counted, _held(ended), ended.log or ""]


def headings_of(sweep: Sweep) -> list[str]:
    """The headings of `rows_of`."""
    return ["point", *(axis.key for axis in sweep.axes), "outcome", "impacts", "drive held", "log"]


def _held(ended: PointState) -> str:
    """With the unit, which stands in brackets in the figure's name."""
    said = (
        f"{ended.figures[name]:.7g} {name.partition('[')[2].rstrip(']')}"
        for name in HELD
        if name in ended.figures
    )
    return next(said, "")


def _figure(sweep: Sweep, state: SweepState) -> Part:
    """A row for each setting of the other axes, with the last one that takes several values along x."""
    if not any(A_CYCLE in ended.figures for ended in state.points.values()):
        return Sentence(_NO_IMPACTS)
    swept = next((axis for axis in reversed(sweep.axes) if len(axis.values) > 1), sweep.axes[-1])
    contacts = RIGS[sweep.rig].contacts
    unit = RIGS[sweep.rig].channel_unit(contacts[0]) if contacts else "m/s2"
    columns = (("impacts a cycle", A_CYCLE, ""), (f"mean peak of the impacts, {unit}", PEAK_MEAN, PEAK_SD))
    rows = _rows(sweep, swept)
    grid = Plots(rows=len(rows), columns=len(columns), row_px=_ROW_PX)
    for row, (setting, points) in enumerate(rows.items()):
        ended = [state.points.get(point.number) for point in points]
        figures = [{} if each is None else each.figures for each in ended]
        symbols = ["circle-open" if back else "circle" for back in _back(swept, len(points))]
        style = Style(BLUE, 1, "lines+markers", symbol=symbols, size=6)
        texts = [f"point {point.number}" for point in points]
        for column, (title, *names) in enumerate(columns):
            cell = len(columns) * row + column
            label, ticks = _x_axis(swept)
            upward = {"rangemode": "tozero"}
            grid.axes(cell, f"{title}  {setting}".rstrip(), label, x_axis=ticks, y_axis=upward)
            values, deviations = ([each.get(name, nan) for each in figures] for name in names)
            x = _along_x(swept, len(points))
            grid.line(cell, "measured", x, values, style, deviations=deviations, texts=texts)
    return grid.figure("sweep", _CAPTION)


def _rows(sweep: Sweep, swept: Axis) -> dict[str, list[Point]]:
    """Points by the settings of all axes but `swept`, in the order in which they come."""
    rows: dict[str, list[Point]] = {}
    for point in sweep.points:
        others = (f"{axis.key} {point.settings[axis.key]}" for axis in sweep.axes if axis is not swept)
        rows.setdefault(", ".join(others), []).append(point)
    return rows


def _along_x(swept: Axis, count: int) -> NDArray[np.float64]:
    known = numbers_of(swept)
    numbers = list(range(len(swept.values))) if known is None else known[0]
    return np.resize(np.array(numbers, np.float64), count)


def _back(swept: Axis, count: int) -> list[bool]:
    """Whether each point lies on the way back of an axis that goes there and back."""
    whole = len(swept.values)
    return [swept.both_ways and 2 * (index % whole) >= whole for index in range(count)]


def _x_axis(swept: Axis) -> tuple[str, dict[str, Any]]:
    """Label and further keys of Plotly's: values that are no numbers stand side by side."""
    known = numbers_of(swept)
    if known is not None:
        return f"{swept.key}, {known[1]}".rstrip(", "), {}
    names = [str(each) for each in swept.values]
    return swept.key, {"tickvals": list(range(len(names))), "ticktext": names}
