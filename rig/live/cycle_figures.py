"""Peak and rms of each cycle of a channel over time, as the log has them below `/derived/`."""

from __future__ import annotations

from typing import NamedTuple

import rerun as rr
import rerun.blueprint as rrb

from daq.block import SampleBlock
from daq.derived_names import CYCLE_PEAK, CYCLE_RMS, derived_name
from daq.log.reader import Origin
from rig.live import paths
from rig.live.displayed_channels import DisplayedChannels
from rig.live.picture import Stage
from rig.live.series import line_style, lines_over_time

_FIGURES = {CYCLE_PEAK: "peak", CYCLE_RMS: "rms"}
_THIN = 0.5
"""The rms lies below the peak, in the same colour; a thinner line tells them apart where they come close."""


class _Series(NamedTuple):
    name: str
    origin: Origin
    figure: str


def figure_views(shown: DisplayedChannels) -> list[rrb.TimeSeriesView]:
    """A view of each channel that has figures; the first one has a legend."""
    views: list[rrb.TimeSeriesView] = []
    for channel, unit in shown.units.items():
        drawn = [paths.derived(series.name) for series in _series(shown, channel)]
        if drawn:
            title = f"{channel}, each cycle [{unit or '-'}]"
            views.append(lines_over_time(drawn, title, shown.window_s, legend=not views))
    return views


class CycleFigurePlots:
    """Fills those views."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        each = (series for channel in stage.shown.units for series in _series(stage.shown, channel))
        self._shown = {series.name: series for series in each}

    def open(self) -> None:
        """Log how the lines look."""
        for name, series in self._shown.items():
            whose = self._stage.shown.whose(series.origin)
            width = paths.WIDTHS[whose] * (_THIN if series.figure == CYCLE_RMS else 1.0)
            style = line_style(whose, f"{whose} {_FIGURES[series.figure]}", width)
            self._stage.recording.log(paths.derived(name), style, static=True)

    def add(self, block: SampleBlock) -> None:
        """Add figures; other derived channels are none."""
        if block.channel in self._shown:
            values = rr.Scalars.columns(scalars=block.values)
            self._stage.columns(paths.derived(block.channel), self._stage.times_of(block), values)


def _series(shown: DisplayedChannels, channel: str) -> list[_Series]:
    """In the order in which they are drawn: the last is on top."""
    each = (
        _Series(derived_name(origin, channel, figure), origin, figure)
        for origin in shown.origins
        for figure in _FIGURES
    )
    return [series for series in each if series.name in shown.derived]
