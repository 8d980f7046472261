"""Impacts over the crank angle at which they were."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from rig.live import paths
from rig.live.axes import DRAW_ORDER, AxesPicture, Axis, Frame, from_zero
from rig.live.crank.impact_peaks import IMPACT_HZ, Blow

_FRAME = Frame(height=3.6, left=1.7, bottom=1.0, top=0.85)
_ANGLES = Axis(0.0, 360.0, tuple((float(at), f"{at}°") for at in range(0, 361, 45)))
_HEADROOM = 1.1


def impact_view(group: str, unit: str) -> rrb.Spatial2DView:
    """A view of one group of channels."""
    return rrb.Spatial2DView(
        origin=_path(group), name=f"Impacts, {group} [{unit or '-'}]", visual_bounds=_FRAME.bounds()
    )


class ImpactPicture:
    """Blows of one group of channels, a dot each."""

    def __init__(self, recording: rr.RecordingStream, group: str, unit: str) -> None:
        self._recording, self._group = recording, group
        what = "contact force" if unit == "N" else f"acceleration above {IMPACT_HZ / 1000:g} kHz"
        caption = f"largest {what} of each impact, over crank angle"
        self._axes = AxesPicture(recording, _path(group), _FRAME, caption)
        self._top = 0.0

    def draw(self, whose: str, blows: Sequence[Blow]) -> None:
        """Log them at the recording's current time, instead of those before."""
        if not blows:
            return
        largest = max(blow.peak for blow in blows)
        if largest > self._top:
            axis = from_zero(_HEADROOM * largest)
            self._top = axis.high
            self._axes.fit(_ANGLES, axis)
        places = self._axes.places([360 * blow.place for blow in blows], [blow.peak for blow in blows])
        dots = rr.Points2D(
            places,
            colors=[paths.COLOURS[whose]],
            radii=rr.Radius.ui_points(3.2 if whose == "measured" else 2.6),
            draw_order=DRAW_ORDER[whose],
        )
        self._recording.log(f"{_path(self._group)}/{whose}", dots)


def _path(group: str) -> str:
    return rr.new_entity_path(["impacts", group])
