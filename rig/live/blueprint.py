"""How the views are arranged: traces and spectra of all channels, and what the rig's picture adds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import rerun.blueprint as rrb

from rig.live import paths
from rig.live.axes import SPECTRUM_FRAME
from rig.live.picture import Layout, OwnViews, in_plot
from rig.live.series import figure_views, newest

_FEW_CHANNELS = 8
"""Up to here every channel has its spectrum beside it; beyond, the spectra have a tab of their own."""

_COLUMNS, _A_PAGE = 3, 12
"""Beyond, in a view at 1280 x 800, the end of a name that tells a channel from the next is cut."""

_PLAIN_SHARE = 0.55
"""Height of the trace of a channel that tells how the rig moves, against that of the others."""


def blueprint(layout: Layout) -> rrb.Blueprint:
    """Arrange traces and spectra on the left; the rig's picture, events and status on the right."""
    own = layout.picture.views(layout) if layout.picture else OwnViews(())
    side = 1.8 if own.beside else 1.15
    told = rrb.Horizontal(
        rrb.TextLogView(
            origin=paths.EVENTS,
            name="Events",
            columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
        ),
        rrb.TextDocumentView(origin=paths.STATUS, name="Status"),
        column_shares=[1.2, 1],
    )
    views = [*(view for view, _ in own.side), told]
    return rrb.Blueprint(
        rrb.Horizontal(
            _channels(layout, own),
            rrb.Vertical(*views, row_shares=[*(share for _, share in own.side), 1.5]),
            column_shares=[3, side],
        ),
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
        contents=[
            f"+ {paths.trace(origin, channel)}"
            for origin, names in layout.origins.items()
            if channel in names
        ],
        name=f"{channel} [{in_plot(layout.units[channel])}]",
        plot_legend=rrb.PlotLegend(visible=channel == next(iter(layout.units))),
        **newest(layout.window_s),
    )


def _channels(layout: Layout, own: OwnViews) -> rrb.Container:
    traces = [channel_view(layout, channel) for channel in layout.units]
    spectra = []
    for channel, unit in layout.units.items():
        if channel not in own.plain:
            squared = f"{unit}²" if unit.isalpha() else f"({in_plot(unit)})²"
            spectra.append(SPECTRUM_FRAME.view(paths.spectrum(channel), f"{channel} [{squared}/Hz]"))
    cycles = figure_views(layout)
    if len(traces) <= _FEW_CHANNELS:
        shares = [_PLAIN_SHARE if channel in own.plain else 1.0 for channel in layout.units]
        beside = _tabs(
            *_stacked(own.beside, "Orders"),
            rrb.Vertical(*spectra, name="Spectra"),
            *_stacked(cycles, "Cycles"),
        )
        upright = rrb.Vertical(*traces, name="Traces", row_shares=shares)
        return rrb.Horizontal(upright, beside, column_shares=[2, 1.3 if own.beside else 1])
    columns = _COLUMNS - bool(own.beside)
    grids: dict[str, Sequence[rrb.View]] = {"Traces": traces, "Spectra": spectra, "Cycles": cycles}
    tabs = _tabs(*(_paged(views, columns, name) for name, views in grids.items() if views))
    if not own.beside:
        return tabs
    return rrb.Horizontal(tabs, rrb.Vertical(*own.beside, name="Orders"), column_shares=[2.4, 1])


def _paged(views: Sequence[rrb.View], columns: int, name: str) -> rrb.Container:
    """A grid, or tabs of grids of about the same size."""
    pages = math.ceil(len(views) / _A_PAGE)
    if pages <= 1:
        return rrb.Grid(*views, grid_columns=columns, name=name)
    edges = [len(views) * page // pages for page in range(pages + 1)]
    return rrb.Tabs(
        *(
            rrb.Grid(*views[first:end], grid_columns=columns, name=f"{first + 1} to {end}")
            for first, end in pairwise(edges)
        ),
        name=name,
    )


def _stacked(views: Sequence[rrb.View | rrb.Container], name: str) -> list[rrb.Vertical]:
    return [rrb.Vertical(*views, name=name)] if views else []


def _tabs(*containers: rrb.Container) -> rrb.Container:
    """The first one on top; none where there is but one."""
    return rrb.Tabs(*containers) if len(containers) > 1 else containers[0]
