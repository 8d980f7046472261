"""Values over time: how lines and points look, how far back a plot of them reaches, figures of each cycle."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.components import AggregationPolicy, MarkerShape, ScalarBatch

from daq.block import SampleBlock
from daq.log.reader import CYCLE_PEAK, CYCLE_RMS, Origin, derived_name
from rig.live import paths
from rig.live.picture import Layout, Stage, in_plot

_QUERIED = 8
"""A view queries this many times the stretch that it shows. Rerun 0.41 draws with the last frame's axis,
which without a graphics card is seconds old; the range of the force axis is steadier for it, too."""

_REACHES = 10
"""What is found once a cycle is shown this many times further back than the traces."""

_MARKERS = {
    "measured": MarkerShape.Circle,
    "nominal": MarkerShape.Cross,
    "predicted": MarkerShape.Diamond,
    "repaired": MarkerShape.Diamond,
    "surrogate": MarkerShape.Square,
}


def line_style(whose: str, name: str = "", width: float | None = None) -> rr.SeriesLines:
    """A line in the colour of `whose` it is; without `name` and `width`, called that and as wide as usual."""
    return rr.SeriesLines(
        colors=[paths.COLOURS[whose]],
        names=[name or whose],
        widths=[paths.WIDTHS[whose] if width is None else width],
        aggregation_policy=AggregationPolicy.MinMax,  # the viewer's default averages, and peaks shrink
    )


def points_style(whose: str) -> rr.SeriesPoints:
    """Points in the colour of `whose` they are."""
    return rr.SeriesPoints(
        colors=[paths.COLOURS[whose]], names=[whose], markers=[_MARKERS[whose]], marker_sizes=[3.0]
    )


def over_time(
    origin: str,
    name: str,
    window_s: float | None,
    legend: bool = True,
    contents: str | list[str] = "$origin/**",
) -> rrb.TimeSeriesView:
    """A plot of all below `origin`, or of `contents`, that reaches further back than the traces do.

    These show `window_s`.
    """
    reach_s = None if window_s is None else _REACHES * window_s
    return rrb.TimeSeriesView(
        origin=origin,
        contents=contents,
        name=name,
        plot_legend=rrb.PlotLegend(visible=legend),
        **newest(reach_s),
    )


def newest(seconds: float | None) -> dict[str, Any]:
    """What a time series of the last `seconds` (None: of all) queries, and its axis, as its arguments."""
    start = end = rr.TimeRangeBoundary.infinite()
    axis = None
    if seconds is not None:
        end = rr.TimeRangeBoundary.cursor_relative()
        start = rr.TimeRangeBoundary.cursor_relative(seconds=-_QUERIED * seconds)
        shown = rr.TimeRange(rr.TimeRangeBoundary.cursor_relative(seconds=-seconds), end)
        axis = rrb.TimeAxis(view_range=shown)
    return {"time_ranges": [rr.VisibleTimeRange(paths.TIMELINE, start=start, end=end)], "axis_x": axis}


_FIGURES = {CYCLE_PEAK: "peak", CYCLE_RMS: "rms"}
_THIN = 0.5
"""The rms lies below the peak, in the same colour; a thinner line tells them apart where they come close."""


class _Series(NamedTuple):
    name: str
    origin: Origin
    figure: str


def figure_views(shown: Layout) -> list[rrb.TimeSeriesView]:
    """A view of each channel that has figures; the first one has a legend."""
    views: list[rrb.TimeSeriesView] = []
    for channel, unit in shown.units.items():
        drawn = [paths.derived(series.name) for series in _series(shown, channel)]
        if drawn:
            title = f"{channel}, each cycle [{in_plot(unit)}]"
            traces = [f"+ {path}" for path in drawn]
            views.append(over_time("/", title, shown.window_s, not views, traces))
    return views


_SCALARS = rr.Scalars.descriptor_scalars()


def scalars(values: NDArray[np.floating]) -> list[rr.ComponentColumn]:
    """What `rr.Scalars.columns` makes of `values`, shape (n,), with fewer steps."""
    offsets = np.arange(len(values) + 1, dtype=np.int32)
    return [rr.ComponentColumn(_SCALARS, ScalarBatch(values), offsets=offsets)]


class CycleFigurePlots:
    """Fills those views."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        each = (series for channel in stage.shown.units for series in _series(stage.shown, channel))
        self._shown = {series.name: series for series in each}

    def open(self) -> None:
        for name, series in self._shown.items():
            whose = self._stage.shown.whose(series.origin)
            width = paths.WIDTHS[whose] * (_THIN if series.figure == CYCLE_RMS else 1.0)
            style = line_style(whose, f"{whose} {_FIGURES[series.figure]}", width)
            self._stage.recording.log(paths.derived(name), style, static=True)

    def add(self, block: SampleBlock) -> None:
        if block.channel in self._shown:
            path = paths.derived(block.channel)
            self._stage.columns(path, self._stage.times_of(block), scalars(block.values))


def _series(shown: Layout, channel: str) -> list[_Series]:
    """In the order in which they are drawn: the last is on top."""
    each = (
        _Series(derived_name(origin, channel, figure), origin, figure)
        for origin in shown.origins
        for figure in _FIGURES
    )
    return [series for series in each if series.name in shown.derived]
