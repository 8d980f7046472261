"""A mechanism in space, moved by the angle of its crank with ideal joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import NamedTuple, Protocol

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.components import FillMode
from scipy.spatial.transform import Rotation

from daq.log.reader import Origin
from rig.derived.turns import Turns
from rig.live import paths
from rig.live.picture import Stage

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


class Solid(Protocol):
    """Something of a body that can be drawn."""

    def drawn(self, colour: Sequence[int]) -> rr.AsComponents:
        """In a colour."""
        ...


@dataclass(frozen=True, slots=True)
class Box:
    """A box around `centre` with half its sides; all in m. Where it hides others, it is `clear`."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    clear: bool = False

    def drawn(self, colour: Sequence[int]) -> rr.AsComponents:
        """In a colour."""
        fill = FillMode.TransparentFillMajorWireframe if self.clear else FillMode.Solid
        return rr.Boxes3D(centers=[self.centre], half_sizes=[self.half], colors=[colour], fill_mode=fill)


@dataclass(frozen=True, slots=True)
class Bar:
    """A round bar with round ends from `start` to `end`; all in m."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float

    def drawn(self, colour: Sequence[int]) -> rr.AsComponents:
        """In a colour."""
        way = np.subtract(self.end, self.start)
        length = float(np.linalg.norm(way))
        return rr.Capsules3D(
            lengths=[length],
            radii=[self.radius],
            translations=[self.start],
            quaternions=[rr.Quaternion(xyzw=_from_z(way / length))],
            colors=[colour],
            fill_mode=FillMode.Solid,
        )


class Mechanism(Protocol):
    """A rig with a crank as it is drawn."""

    def fixed(self) -> tuple[Solid, ...]:
        """What does not move."""
        ...

    def bodies(self) -> tuple[Body, ...]:
        """What moves."""
        ...

    def poses(self, angle: NDArray[np.float64]) -> tuple[Pose, ...]:
        """Where each body is at crank angles in rad, shape (n,), with ideal joints."""
        ...


class MovingMechanism:
    """Draws the mechanism of every origin: as solids what was measured, else what was predicted.

    Where both are, the predicted one is a thin line over the solids.
    """

    def __init__(self, stage: Stage, mechanism: Mechanism, origins: Sequence[Origin]) -> None:
        self._stage, self._mechanism = stage, mechanism
        self._origins = origins
        self._next = dict.fromkeys(origins, 0)

    def open(self) -> None:
        """Log the frame and the bodies in their own axes."""
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
        if known.any():
            self._move(origin, times_s[known], angle[known])

    def _move(self, origin: Origin, times_s: NDArray[np.float64], angle: NDArray[np.float64]) -> None:
        poses = self._mechanism.poses(angle)
        for body, pose in zip(self._mechanism.bodies(), poses, strict=True):
            moved = rr.Transform3D.columns(
                translation=pose.place, quaternion=Rotation.from_matrix(pose.turned).as_quat()
            )
            self._stage.columns(f"{PATH}/{origin}/{body.name}", times_s, moved)


def turned_to(along: NDArray[np.float64], side: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes whose x lies `along` (unit vectors, (n, 3)) and whose z is as near to `side` (3,) as can be."""
    y = np.cross(np.broadcast_to(side, along.shape), along)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack((along, y, np.cross(along, y)), axis=2)


def _from_z(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation that turns z to the unit vector `way`, as a quaternion xyzw."""
    return np.asarray(Rotation.align_vectors([way], [[0.0, 0.0, 1.0]])[0].as_quat())
