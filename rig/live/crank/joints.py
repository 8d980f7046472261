"""Where journals are in their bearings, the clearance enlarged until it can be seen."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from rig.live import paths
from rig.live.picture import Stage

PATH = "/joints"
_REMEMBERED = 150
"""Shapes; of a live run they come some ten times a second."""

_APART = 5.4
_POINTS_ROUND = 73


@dataclass(frozen=True, slots=True)
class Joint:
    """A clearance in m, `round` or square, and the names of the two directions it is looked at in."""

    name: str
    clearance_m: float
    across: str
    up: str
    round: bool = True

    def outline(self) -> NDArray[np.float64]:
        """What a centre may reach before it touches, in clearances, shape (k, 2)."""
        if not self.round:
            return np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]], dtype=np.float64)
        angle = np.linspace(0.0, 2 * np.pi, _POINTS_ROUND)
        return np.column_stack((np.cos(angle), np.sin(angle)))


def joints_view(joints: Sequence[Joint]) -> rrb.Spatial2DView:
    """A view of them side by side."""
    return rrb.Spatial2DView(
        origin=PATH,
        name="Predicted: where journals are within their clearances, ten times a second",
        visual_bounds=rrb.VisualBounds2D(x_range=(-1.6, _APART * len(joints) - 1.6), y_range=(-1.3, 1.3)),
    )


class JointPicture:
    """The newest places of every journal, as dots in the outline of its clearance."""

    def __init__(self, stage: Stage, joints: Sequence[Joint]) -> None:
        self._stage, self._joints = stage, joints
        self._places: deque[NDArray[np.float64]] = deque(maxlen=_REMEMBERED)

    def open(self) -> None:
        """Log the outlines and what they are."""
        outlines = [_side_by_side(joint.outline(), at) for at, joint in enumerate(self._joints)]
        crosses = [
            _side_by_side(np.array(line), at)
            for at in range(len(self._joints))
            for line in ([[-1.15, 0.0], [1.15, 0.0]], [[0.0, -1.15], [0.0, 1.15]])
        ]
        recording = self._stage.recording
        thin = rr.LineStrips2D(crosses, colors=[paths.DIM], radii=rr.Radius.ui_points(0.4), draw_order=1.0)
        recording.log(f"{PATH}/crosses", thin, static=True)
        bound = rr.LineStrips2D(outlines, colors=[paths.DIM], radii=rr.Radius.ui_points(0.8), draw_order=2.0)
        recording.log(f"{PATH}/outlines", bound, static=True)
        recording.log(f"{PATH}/labels", self._labels(), static=True)

    def show(self, time_s: float, eccentricity_m: NDArray[np.float64]) -> None:
        """Add the journals at `time_s`: centre of the journal less that of its bearing, shape (joints, 2)."""
        clearances = np.array([[joint.clearance_m] for joint in self._joints])
        self._places.append(eccentricity_m / clearances)
        places = np.array(self._places)
        dots = np.concatenate([_side_by_side(places[:, at], at) for at in range(len(self._joints))])
        newest = np.concatenate([_side_by_side(places[-1:, at], at) for at in range(len(self._joints))])
        colour = paths.COLOURS["predicted"]
        self._stage.at(time_s)
        trail = rr.Points2D(dots, colors=[colour], radii=rr.Radius.ui_points(2.0), draw_order=3.0)
        self._stage.recording.log(f"{PATH}/trail", trail)
        now = rr.Points2D(newest, colors=[colour], radii=rr.Radius.ui_points(5.0), draw_order=4.0)
        self._stage.recording.log(f"{PATH}/now", now)

    def _labels(self) -> rr.Points2D:
        places, texts = [], []
        for at, joint in enumerate(self._joints):
            places += [
                (_APART * at + x, y) for x, y in ((2.5, -1.15), (2.5, -0.6), (1.35, 0.0), (0.25, -1.1))
            ]
            texts += [joint.name, f"±{1000 * joint.clearance_m:.3g} mm", joint.across, joint.up]
        return rr.Points2D(
            places, labels=texts, show_labels=True, colors=[paths.LABEL], radii=rr.Radius.ui_points(0.0)
        )


def _side_by_side(points: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """In the picture's plane, whose y points downward."""
    return points * [1.0, -1.0] + [_APART * number, 0.0]
