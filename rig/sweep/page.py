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
from rig.report.content import Figure, Part, Sentence, Table
from rig.report.page import page
from rig.report.plot import PlotGrid
from rig.rigs import RIGS
from rig.sweep.results import A_CYCLE, HELD, PEAK_MEAN, PEAK_SD, impacts_recorded
from rig.sweep.state import PointState, SweepState, write_whole

PAGE: Final = "sweep.html"
_ROW_PX: Final = 240
_CAPTION: Final = (
    "Bars: standard deviation of the peaks. Hollow: on the way back; the drive came there through all values "
    "before, without a rest."
)
_NO_IMPACTS: Final = "No record of this sweep says how many impacts it holds."


def write_page(folder: Path, sweep: Sweep, state: SweepState) -> Path:
    """Write the page beside the logs; returns its path, raises RecorderFailed."""
    done = state.ended("done")
    subtitle = [sweep.rig.replace("_", " "), f"{len(done)} of {len(sweep.points)} points done"]
    sections: list[tuple[str, list[Part]]] = [
        ("Impacts over the swept value", _figures(sweep, state)),
        ("Points", [_table(sweep, state)]),
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
    said = (f"{ended.figures[name]:.7g} {_unit(name)}" for name in HELD if name in ended.figures)
    return next(said, "")


def _unit(name: str) -> str:
    return name.partition("[")[2].rstrip("]")


def _table(sweep: Sweep, state: SweepState) -> Table:
    return Table(headings_of(sweep), list(rows_of(sweep, state)), "Points that have ended", words=True)


def _figures(sweep: Sweep, state: SweepState) -> list[Part]:
    if not any(A_CYCLE in ended.figures for ended in state.points.values()):
        return [Sentence(_NO_IMPACTS)]
    return [_figure(sweep, state)]


def _figure(sweep: Sweep, state: SweepState) -> Figure:
    """A row for each setting of the other axes, with the last one that takes several values along x."""
    swept = next((axis for axis in reversed(sweep.axes) if len(axis.values) > 1), sweep.axes[-1])
    contacts = RIGS[sweep.rig].contacts
    unit = RIGS[sweep.rig].channel_unit(contacts[0]) if contacts else "m/s2"
    columns = (("impacts a cycle", A_CYCLE, ""), (f"mean peak of the impacts, {unit}", PEAK_MEAN, PEAK_SD))
    rows = _rows(sweep, swept)
    grid = PlotGrid(rows=len(rows), columns=len(columns), row_px=_ROW_PX)
    for row, (setting, points) in enumerate(rows.items()):
        ended = [state.points.get(point.number) for point in points]
        figures = [{} if each is None else each.figures for each in ended]
        for column, (title, *names) in enumerate(columns):
            cell = len(columns) * row + column
            grid.axes(cell, f"{title}  {setting}".rstrip(), _x_axis(swept), {"rangemode": "tozero"})
            values, deviations = (np.array([each.get(name, nan) for each in figures]) for name in names)
            labels = [f"point {point.number}" for point in points]
            grid.points(
                cell, _along_x(swept, len(points)), values, deviations, labels, _back(swept, len(points))
            )
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


def _x_axis(swept: Axis) -> dict[str, Any]:
    known = numbers_of(swept)
    if known is not None:
        return {"title": {"text": f"{swept.key}, {known[1]}".rstrip(", ")}}
    ticks = {"tickvals": list(range(len(swept.values))), "ticktext": [str(each) for each in swept.values]}
    return {"title": {"text": swept.key}, **ticks}
