"""Plots of a crank: impacts over its angle, amplitudes over orders, speed over time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import isfinite, pi

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from daq.log.reader import Origin
from daq.log.records import Impact
from rig.derived.order_lines import HIGHEST_ORDER, LOWEST_ORDER, largest_in_bands
from rig.live import paths
from rig.live.axes import DRAW_ORDER, AxesPicture, Axis, Frame, decades, from_zero
from rig.live.picture import Stage
from rig.live.series import line_style, over_time
from sim_twin.rigs.channel_table import Role

IMPACT_FRAME = Frame(height=3.6, left=1.7, bottom=1.0, top=0.85)
_ANGLES = Axis(0.0, 360.0, tuple((float(at), f"{at}°") for at in range(0, 361, 45)))
_HEADROOM = 1.1
_DOTS = 600
_DRAWS_EVERY_S = 1.0

ORDER_FRAME = Frame(height=10.0, left=2.4, bottom=3.0)
_DECADES = 5
_TICKS = (0.5, 1, 2, 5, 10, 20, 50, 200)
_ORDERS = Axis(LOWEST_ORDER, HIGHEST_ORDER, tuple((at, f"{at:g}") for at in _TICKS), logarithmic=True)
_SPEED_PATH = "/speed"
_BAND = 0.01
"""Of the set speed, drawn above and below it, so that noise is never blown up to fill the plot."""
_RPM = 60 / (2 * pi)
_SET_COLOUR = (150, 150, 150)


@dataclass(slots=True)
class _Cloud:
    """The newest dots of one origin: angles in degrees with peaks."""

    dots: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_DOTS))
    drawn_s: float = 0.0
    waits: bool = False


class ImpactPicture:
    """Impacts of one group of channels, a dot each, drawn anew once a second."""

    def __init__(self, stage: Stage, group: str, role: Role) -> None:
        self._stage, self._group = stage, group
        what = "peak of each impact" if role is Role.CONTACT else "magnitude of each burst"
        caption = f"largest {what}, over the crank angle at which it begins"
        self._axes = AxesPicture(stage.recording, paths.impacts(group), IMPACT_FRAME, caption)
        self._axis = from_zero(1.0)
        self._top = self._newest_s = 0.0
        self._clouds: dict[str, _Cloud] = {}

    def add(self, whose: str, time_s: float, impact: Impact) -> None:
        """Take an impact that began at `time_s`; one without an angle has no place here."""
        if not isfinite(impact.turns):
            return
        cloud = self._clouds.setdefault(whose, _Cloud())
        cloud.dots.append((360.0 * (impact.turns % 1.0), impact.peak))
        cloud.waits = True
        self._newest_s = max(self._newest_s, time_s)
        if self._newest_s >= cloud.drawn_s + _DRAWS_EVERY_S:
            self._draw(whose)

    def finish(self) -> None:
        for whose, cloud in self._clouds.items():
            if cloud.waits:
                self._draw(whose)

    def _draw(self, whose: str) -> None:
        """Draw the cloud of `whose` anew; every cloud where a larger peak changes the scale."""
        self._stage.at(self._newest_s)
        drawn = {whose: self._clouds[whose]}
        largest = max(peak for cloud in self._clouds.values() for _, peak in cloud.dots)
        if largest > self._top:
            self._axis = from_zero(_HEADROOM * largest)
            self._top = self._axis.high
            drawn = self._clouds
        self._axes.fit(_ANGLES, self._axis)
        for each, cloud in drawn.items():
            cloud.drawn_s, cloud.waits = self._newest_s, False
            angles, peaks = zip(*cloud.dots, strict=True)
            dots = rr.Points2D(
                self._axes.places(angles, peaks),
                colors=[paths.COLOURS[each]],
                radii=rr.Radius.ui_points(3.2 if each == "measured" else 2.6),
                draw_order=DRAW_ORDER[each],
            )
            self._stage.recording.log(f"{paths.impacts(self._group)}/{each}", dots)


class OrderPicture:
    """One channel's measured and predicted order spectrum."""

    def __init__(self, recording: rr.RecordingStream, channel: str) -> None:
        self._axes = AxesPicture(recording, paths.orders(channel), ORDER_FRAME)
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
        self._axes.line(whose, order, amplitude)


def speed_view(set_rad_s: float, window_s: float | None) -> rrb.TimeSeriesView:
    """A view of the speeds."""
    name = f"Crank speed [rpm]; set: {set_rad_s * _RPM:.4g} rpm, dim: ±{100 * _BAND:g} %"
    return over_time(_SPEED_PATH, name, window_s, legend=False)


class SpeedPlot:
    """Measured and predicted speed, and lines at the set one."""

    def __init__(self, stage: Stage, set_rad_s: float) -> None:
        self._stage = stage
        rpm = set_rad_s * _RPM
        self._set_rpm = {"set": rpm, "upper": (1 + _BAND) * rpm, "lower": (1 - _BAND) * rpm}
        self._reached_s = -1.0

    def open(self) -> None:
        recording, shown = self._stage.recording, self._stage.shown
        for origin, names in shown.origins.items():
            if names:
                recording.log(f"{_SPEED_PATH}/{origin}", line_style(shown.whose(origin)), static=True)
        for name in self._set_rpm:
            colour = _SET_COLOUR if name == "set" else paths.DIM
            style = rr.SeriesLines(colors=[colour], names=[name], widths=[0.9])
            recording.log(f"{_SPEED_PATH}/{name}", style, static=True)

    def show(self, origin: Origin, times_s: NDArray[np.float64], rpm: NDArray[np.floating]) -> None:
        """Add speeds in rpm, where they are known, at times in s; both of shape (n,)."""
        known = np.isfinite(rpm)
        if not known.any():
            return
        self._send(origin, times_s[known], rpm[known])
        begin_s, end_s = float(times_s[0]), float(times_s[-1])
        if end_s > self._reached_s:
            for name, speed in self._set_rpm.items():
                self._send(name, np.array([begin_s, end_s]), np.full(2, speed))
            self._reached_s = end_s

    def _send(self, name: str, times_s: NDArray[np.float64], rpm: NDArray[np.floating]) -> None:
        self._stage.columns(f"{_SPEED_PATH}/{name}", times_s, rr.Scalars.columns(scalars=rpm))
