"""Amplitudes over orders, both on decades."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from rig.crank.order_lines import HIGHEST_ORDER, LOWEST_ORDER, largest_in_bands
from rig.live import paths
from rig.live.axes import DRAW_ORDER, AxesPicture, Axis, Frame, decades

_FRAME = Frame(height=10.0, left=2.4, bottom=1.6)
_DECADES = 5
_TICKS = (0.5, 1, 2, 5, 10, 20, 50, 100, 200)
_ORDERS = Axis(LOWEST_ORDER, HIGHEST_ORDER, tuple((at, f"{at:g}") for at in _TICKS), logarithmic=True)


def order_view(channel: str, unit: str) -> rrb.Spatial2DView:
    """A view of one channel's orders."""
    return rrb.Spatial2DView(
        origin=_path(channel), name=f"{channel} over orders [{unit or '-'}]", visual_bounds=_FRAME.bounds()
    )


class OrderPicture:
    """One channel's measured and predicted order spectrum."""

    def __init__(self, recording: rr.RecordingStream, channel: str) -> None:
        self._recording, self._channel = recording, channel
        self._axes = AxesPicture(recording, _path(channel), _FRAME)
        self._axis: Axis | None = None

    def draw(self, whose: str, order: NDArray[np.float64], amplitude: NDArray[np.float64]) -> None:
        """Log lines, both of shape (m,), at the recording's current time."""
        order, amplitude = largest_in_bands(order, amplitude)
        if not len(order):
            return
        largest = float(amplitude.max())
        if self._axis is None or largest > self._axis.high:
            self._axis = decades(1.5 * largest, _DECADES)
        self._axes.fit(_ORDERS, self._axis)
        line = rr.LineStrips2D(
            [self._axes.places(order, amplitude)],
            colors=[paths.COLOURS[whose]],
            radii=rr.Radius.ui_points(paths.WIDTHS[whose] / 2),
            draw_order=DRAW_ORDER[whose],
        )
        self._recording.log(f"{_path(self._channel)}/{whose}", line)


def _path(channel: str) -> str:
    return rr.new_entity_path(["orders", channel])
