"""How the views are arranged, from nothing but the layout's channels."""

from __future__ import annotations

import math

import rerun as rr
import rerun.blueprint as rrb

from daq.log.reader import Origin
from rig.live import paths, spectrum_picture
from rig.live.beam_picture import BeamPicture
from rig.live.half_cycle_peaks import LOWER, UPPER
from rig.live.layout import Layout

_FEW_CHANNELS = 8
"""Up to here every channel has its spectrum beside it; beyond, the spectra have a tab of their own."""

_QUERIED = 8
"""A view queries this many times the stretch that it shows. Rerun 0.41 draws with the last frame's axis,
which without a graphics card is seconds old; the range of the force axis is steadier for it, too."""

_PEAKS_SHOWN = 10
"""The peaks' plot reaches this many times further back than the traces."""


def blueprint(layout: Layout) -> rrb.Blueprint:
    """Arrange traces and spectra on the left; beam, peaks, events and status on the right."""
    return rrb.Blueprint(
        rrb.Horizontal(_channels(layout), _side(layout), column_shares=[3, 1.15]),
        rrb.TimePanel(state="collapsed", timeline=paths.TIMELINE, play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def channel_view(layout: Layout, channel: str) -> rrb.TimeSeriesView:
    """Measured over predicted of one channel."""
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"+ {paths.trace(origin, channel)}" for origin in _drawing_order(layout, channel)],
        name=f"{channel} [{layout.units[channel] or '-'}]",
        plot_legend=rrb.PlotLegend(visible=channel == next(iter(layout.units))),
        time_ranges=_newest(layout.window_s),
        axis_x=_axis(layout.window_s),
    )


def _channels(layout: Layout) -> rrb.Container:
    traces = [channel_view(layout, channel) for channel in layout.units]
    spectra = [_spectrum_view(channel, unit) for channel, unit in layout.units.items()]
    if len(traces) <= _FEW_CHANNELS:
        return rrb.Horizontal(
            rrb.Vertical(*traces, name="Traces"), rrb.Vertical(*spectra, name="Spectra"), column_shares=[2, 1]
        )
    columns = math.ceil(math.sqrt(len(traces)))
    return rrb.Tabs(
        rrb.Grid(*traces, grid_columns=columns, name="Traces"),
        rrb.Grid(*spectra, grid_columns=columns, name="Spectra"),
    )


def _side(layout: Layout) -> rrb.Container:
    views: list[rrb.View | rrb.Container] = []
    shares = []
    if layout.beam is not None:
        views.append(_beam_view(layout.beam))
        shares.append(3.0)
    if UPPER in layout.units and LOWER in layout.units:
        views.append(_peaks_view(layout))
        shares.append(2.5)
    views += [
        rrb.TextLogView(origin=paths.EVENTS, name="Events"),
        rrb.TextDocumentView(origin=paths.STATUS, name="Status"),
    ]
    return rrb.Vertical(*views, row_shares=[*shares, 2.0, 1.0])


def _peaks_view(layout: Layout) -> rrb.TimeSeriesView:
    window_s = None if layout.window_s is None else _PEAKS_SHOWN * layout.window_s
    return rrb.TimeSeriesView(
        origin=paths.PEAKS,
        name="Largest force of each half cycle [N]",
        plot_legend=rrb.PlotLegend(visible=True),
        time_ranges=_newest(window_s),
        axis_x=_axis(window_s),
    )


def _beam_view(beam: BeamPicture) -> rrb.Spatial3DView:
    length = beam.length_m
    return rrb.Spatial3DView(
        origin=paths.BEAM,
        name=f"Predicted beam, stops ±{1000 * beam.clearance_m:.3f} mm, drawn {beam.magnification:.0f} x",
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=(0.42 * length, -0.95 * length, 0.3 * length),
            look_target=(0.52 * length, 0.0, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )


def _spectrum_view(channel: str, unit: str) -> rrb.Spatial2DView:
    picture = spectrum_picture
    return rrb.Spatial2DView(
        origin=paths.spectrum(channel),
        name=f"{channel} [{_squared(unit)}/Hz]",
        visual_bounds=rrb.VisualBounds2D(
            x_range=(-picture.LEFT, picture.WIDTH + 0.5), y_range=(-0.3, picture.HEIGHT + picture.BOTTOM)
        ),
    )


def _squared(unit: str) -> str:
    return f"{unit}²" if unit.isalpha() else f"({unit or '-'})²"


def _drawing_order(layout: Layout, channel: str) -> list[Origin]:
    return [origin for origin, names in layout.origins.items() if channel in names]


def _newest(seconds: float | None) -> list[rr.VisibleTimeRange]:
    """What a view of the last `seconds` queries."""
    if seconds is None:
        start, end = rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.infinite()
    else:
        start = rr.TimeRangeBoundary.cursor_relative(seconds=-_QUERIED * seconds)
        end = rr.TimeRangeBoundary.cursor_relative()
    return [rr.VisibleTimeRange(paths.TIMELINE, start=start, end=end)]


def _axis(seconds: float | None) -> rrb.TimeAxis | None:
    if seconds is None:
        return None
    start = rr.TimeRangeBoundary.cursor_relative(seconds=-seconds)
    return rrb.TimeAxis(view_range=rr.TimeRange(start, rr.TimeRangeBoundary.cursor_relative()))
