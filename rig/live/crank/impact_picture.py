"""Impacts over the crank angle at which they began."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import isfinite

import rerun as rr
import rerun.blueprint as rrb

from daq.log.records import Impact
from rig.live import paths
from rig.live.axes import DRAW_ORDER, AxesPicture, Axis, Frame, from_zero
from rig.live.picture import Stage

_FRAME = Frame(height=3.6, left=1.7, bottom=1.0, top=0.85)
_ANGLES = Axis(0.0, 360.0, tuple((float(at), f"{at}°") for at in range(0, 361, 45)))
_HEADROOM = 1.1
_DOTS = 600
_DRAWS_EVERY_S = 1.0


def impact_view(group: str, unit: str) -> rrb.Spatial2DView:
    """A view of one group of channels."""
    return rrb.Spatial2DView(
        origin=_path(group), name=f"Impacts, {group} [{unit or '-'}]", visual_bounds=_FRAME.bounds()
    )


@dataclass(slots=True)
class _Cloud:
    """The newest dots of one origin: angles in degrees with peaks."""

    dots: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_DOTS))
    drawn_s: float = 0.0
    waits: bool = False


class ImpactPicture:
    """Impacts of one group of channels, a dot each, drawn anew once a second."""

    def __init__(self, stage: Stage, group: str, unit: str) -> None:
        self._stage, self._group = stage, group
        what = "contact force of each impact" if unit == "N" else "acceleration of each burst"
        caption = f"largest {what}, over the crank angle at which it begins"
        self._axes = AxesPicture(stage.recording, _path(group), _FRAME, caption)
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
        """Draw those that wait for more."""
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
            self._log(each, cloud)

    def _log(self, whose: str, cloud: _Cloud) -> None:
        """Log all its dots instead of those before."""
        cloud.drawn_s, cloud.waits = self._newest_s, False
        angles, peaks = zip(*cloud.dots, strict=True)
        dots = rr.Points2D(
            self._axes.places(angles, peaks),
            colors=[paths.COLOURS[whose]],
            radii=rr.Radius.ui_points(3.2 if whose == "measured" else 2.6),
            draw_order=DRAW_ORDER[whose],
        )
        self._stage.recording.log(f"{_path(self._group)}/{whose}", dots)


def _path(group: str) -> str:
    return rr.new_entity_path(["impacts", group])
