"""Speed over time, beside the speed that was set."""

from __future__ import annotations

from math import pi

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from daq.log.reader import Origin
from rig.live import paths
from rig.live.picture import Stage
from rig.live.series import line_style, scatter_over_time

PATH = "/speed"
_BAND = 0.01
"""Of the set speed, drawn above and below it, so that noise is never blown up to fill the plot."""

_RPM = 60 / (2 * pi)
_SET_COLOUR = (150, 150, 150)


def speed_view(set_rad_s: float, window_s: float | None) -> rrb.TimeSeriesView:
    """A view of the speeds."""
    name = f"Crank speed [rpm]; set: {set_rad_s * _RPM:.4g} rpm, dim: ±{100 * _BAND:g} %"
    return scatter_over_time(PATH, name, window_s, legend=False)


class SpeedPlot:
    """Measured and predicted speed, and lines at the set one."""

    def __init__(self, stage: Stage, set_rad_s: float) -> None:
        self._stage = stage
        rpm = set_rad_s * _RPM
        self._set_rpm = {"set": rpm, "upper": (1 + _BAND) * rpm, "lower": (1 - _BAND) * rpm}
        self._reached_s = -1.0

    def open(self) -> None:
        """Log how the lines look."""
        recording, shown = self._stage.recording, self._stage.shown
        for origin, names in shown.origins.items():
            if names:
                recording.log(f"{PATH}/{origin}", line_style(shown.whose(origin)), static=True)
        for name in self._set_rpm:
            colour = _SET_COLOUR if name == "set" else paths.DIM
            style = rr.SeriesLines(colors=[colour], names=[name], widths=[0.9])
            recording.log(f"{PATH}/{name}", style, static=True)

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
        self._stage.columns(f"{PATH}/{name}", times_s, rr.Scalars.columns(scalars=rpm))
