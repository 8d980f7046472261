"""Values over time: how lines and points look, and how far back a plot of them reaches."""

from __future__ import annotations

import rerun as rr
import rerun.blueprint as rrb
from rerun.components import AggregationPolicy, MarkerShape

from rig.live import paths

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


def scatter_over_time(
    origin: str, name: str, window_s: float | None, legend: bool = True
) -> rrb.TimeSeriesView:
    """A plot of all below `origin` that reaches further back than the traces, which show `window_s`."""
    return _far_back(name, window_s, legend, origin, "$origin/**")


def lines_over_time(drawn: list[str], name: str, window_s: float | None, legend: bool) -> rrb.TimeSeriesView:
    """The same of these entities."""
    return _far_back(name, window_s, legend, "/", [f"+ {path}" for path in drawn])


def _far_back(
    name: str, window_s: float | None, legend: bool, origin: str, contents: str | list[str]
) -> rrb.TimeSeriesView:
    reach_s = None if window_s is None else _REACHES * window_s
    return rrb.TimeSeriesView(
        origin=origin,
        contents=contents,
        name=name,
        plot_legend=rrb.PlotLegend(visible=legend),
        time_ranges=newest(reach_s),
        axis_x=newest_axis(reach_s),
    )


def newest(seconds: float | None) -> list[rr.VisibleTimeRange]:
    """What a view of the last `seconds` (None: of all) queries."""
    if seconds is None:
        start, end = rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.infinite()
    else:
        start = rr.TimeRangeBoundary.cursor_relative(seconds=-_QUERIED * seconds)
        end = rr.TimeRangeBoundary.cursor_relative()
    return [rr.VisibleTimeRange(paths.TIMELINE, start=start, end=end)]


def newest_axis(seconds: float | None) -> rrb.TimeAxis | None:
    """The axis of a view of the last `seconds`."""
    if seconds is None:
        return None
    start = rr.TimeRangeBoundary.cursor_relative(seconds=-seconds)
    return rrb.TimeAxis(view_range=rr.TimeRange(start, rr.TimeRangeBoundary.cursor_relative()))
