"""A mechanism in space, moved by its crank with ideal joints, and the journals in their bearings."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.components import FillMode
from scipy.spatial.transform import Rotation

from daq.log.reader import Origin
from rig.derived.turns import Turns
from rig.live import paths
from rig.live.picture import Stage

if TYPE_CHECKING:
    from rig.live.crank_picture import CrankPicture

PATH = "/mechanism"
FRAME_COLOUR = (128, 133, 141)
_PICTURES_PER_S = 32.0
"""At 230 rpm one in each 43 degrees; a paused view steps through them."""

_MOST_AT_ONCE = 96
_BODY_SHADES = (1.0, 0.72, 0.86)


class Pose(NamedTuple):
    """Where a body's own origin is, m, shape (n, 3), and how its axes lie, shape (n, 3, 3)."""

    place: NDArray[np.float64]
    turned: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Body:
    """A moving part in its own axes, m: solids of which it consists, and a line that stands for it."""

    name: str
    solids: tuple[Solid, ...]
    line: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class Box:
    """A box around `centre` with half its sides; all in m. Where it hides others, it is `clear`."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    clear: bool = False

    def drawn(self, colour: Sequence[int]) -> rr.AsComponents:
        fill = FillMode.TransparentFillMajorWireframe if self.clear else FillMode.Solid
        return rr.Boxes3D(centers=[self.centre], half_sizes=[self.half], colors=[colour], fill_mode=fill)


@dataclass(frozen=True, slots=True)
class Bar:
    """A round bar with round ends from `start` to `end`; all in m."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float

    def drawn(self, colour: Sequence[int]) -> rr.AsComponents:
        way = np.subtract(self.end, self.start)
        length = float(np.linalg.norm(way))
        from_z, _ = Rotation.align_vectors([way / length], [[0.0, 0.0, 1.0]])
        return rr.Capsules3D(
            lengths=[length],
            radii=[self.radius],
            translations=[self.start],
            quaternions=[rr.Quaternion(xyzw=np.asarray(from_z.as_quat()))],
            colors=[colour],
            fill_mode=FillMode.Solid,
        )


Solid = Box | Bar


class MovingMechanism:
    """Draws the mechanism of every origin: as solids what was measured, else what was predicted.

    Where both are, the predicted one is a thin line over the solids.
    """

    def __init__(self, stage: Stage, mechanism: CrankPicture, origins: Sequence[Origin]) -> None:
        self._stage, self._mechanism = stage, mechanism
        self._origins = origins
        self._next = dict.fromkeys(origins, 0)

    def open(self) -> None:
        recording = self._stage.recording
        for number, solid in enumerate(self._mechanism.fixed()):
            recording.log(f"{PATH}/frame/{number}", solid.drawn(FRAME_COLOUR), static=True)
        for origin in self._origins:
            for number, body in enumerate(self._mechanism.bodies()):
                colour = paths.COLOURS[self._stage.shown.whose(origin)]
                path = f"{PATH}/{origin}/{body.name}"
                if origin != self._origins[0]:
                    line = rr.LineStrips3D([body.line], colors=[colour], radii=rr.Radius.ui_points(1.2))
                    recording.log(f"{path}/line", line, static=True)
                    continue
                shade = _BODY_SHADES[number % len(_BODY_SHADES)]
                for part, solid in enumerate(body.solids):
                    shaded = [round(shade * each) for each in colour]
                    recording.log(f"{path}/{part}", solid.drawn(shaded), static=True)

    def follow(self, origin: Origin, turns: Turns, sample_rate: float) -> None:
        """Show the poses that are known by now and have not been shown, at most some 3 s of them."""
        if origin not in self._next:
            return
        end = int((turns.known_until - 1) / sample_rate * _PICTURES_PER_S) + 1
        first = max(min(self._next[origin], end), end - _MOST_AT_ONCE)
        self._next[origin] = end
        times_s = np.arange(first, end) / _PICTURES_PER_S
        angle = 2 * pi * turns.at(np.round(times_s * sample_rate).astype(np.int64))
        known = np.isfinite(angle)
        if not known.any():
            return
        poses = self._mechanism.poses(angle[known])
        for body, pose in zip(self._mechanism.bodies(), poses, strict=True):
            moved = rr.Transform3D.columns(
                translation=pose.place, quaternion=Rotation.from_matrix(pose.turned).as_quat()
            )
            self._stage.columns(f"{PATH}/{origin}/{body.name}", times_s[known], moved)


def turned_to(along: NDArray[np.float64], side: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes whose x lies `along` (unit vectors, (n, 3)) and whose z is as near to `side` (3,) as can be."""
    y = np.cross(np.broadcast_to(side, along.shape), along)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack((along, y, np.cross(along, y)), axis=2)


JOINTS_PATH = "/joints"
SQUARE = ((1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1))
"""Its corners, all the way round."""
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
            return np.array(SQUARE, dtype=np.float64)
        angle = np.linspace(0.0, 2 * np.pi, _POINTS_ROUND)
        return np.column_stack((np.cos(angle), np.sin(angle)))


def joints_view(joints: Sequence[Joint]) -> rrb.Spatial2DView:
    """A view of them side by side."""
    return rrb.Spatial2DView(
        origin=JOINTS_PATH,
        name="Predicted: where journals are",
        visual_bounds=rrb.VisualBounds2D(x_range=(-1.6, _APART * len(joints) - 0.7), y_range=(-1.3, 1.3)),
    )


class JointPicture:
    """The newest places of every journal, as dots in the outline of its clearance."""

    def __init__(self, stage: Stage, joints: Sequence[Joint]) -> None:
        self._stage, self._joints = stage, joints
        self._places: deque[NDArray[np.float64]] = deque(maxlen=_REMEMBERED)

    def open(self) -> None:
        outlines = [_side_by_side(joint.outline(), at) for at, joint in enumerate(self._joints)]
        crosses = [
            _side_by_side(np.array(line), at)
            for at in range(len(self._joints))
            for line in ([[-1.15, 0.0], [1.15, 0.0]], [[0.0, -1.15], [0.0, 1.15]])
        ]
        recording = self._stage.recording
        thin = rr.LineStrips2D(crosses, colors=[paths.DIM], radii=rr.Radius.ui_points(0.4), draw_order=1.0)
        recording.log(f"{JOINTS_PATH}/crosses", thin, static=True)
        bound = rr.LineStrips2D(outlines, colors=[paths.DIM], radii=rr.Radius.ui_points(0.8), draw_order=2.0)
        recording.log(f"{JOINTS_PATH}/outlines", bound, static=True)
        places, texts = [], []
        for at, joint in enumerate(self._joints):
            places += [
                (_APART * at + x, y) for x, y in ((2.5, -1.15), (2.5, -0.6), (1.35, 0.0), (0.25, -1.1))
            ]
            texts += [joint.name, f"±{1000 * joint.clearance_m:.3g} mm", joint.across, joint.up]
        labels = rr.Points2D(
            places, labels=texts, show_labels=True, colors=[paths.LABEL], radii=rr.Radius.ui_points(0.0)
        )
        recording.log(f"{JOINTS_PATH}/labels", labels, static=True)

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
        self._stage.recording.log(f"{JOINTS_PATH}/trail", trail)
        now = rr.Points2D(newest, colors=[colour], radii=rr.Radius.ui_points(5.0), draw_order=4.0)
        self._stage.recording.log(f"{JOINTS_PATH}/now", now)


def _side_by_side(points: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """In the picture's plane, whose y points downward."""
    return points * [1.0, -1.0] + [_APART * number, 0.0]
