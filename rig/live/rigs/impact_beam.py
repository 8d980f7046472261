"""The beam in space, its deflection enlarged until the clearance can be seen, and its impacts."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from daq.log.reader import Origin
from daq.log.records import Impact
from rig.live import paths
from rig.live.picture import Layout, OwnViews, Stage, looking
from rig.live.series import over_time, points_style
from rig.live.sketch import FRAMES, LATER, Line, sketched
from rig.stream import Record, Shape
from sim_twin.rigs.impact_beam.channels import LOWER, UPPER

if TYPE_CHECKING:
    from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
    from sim_twin.twin import Twin

_SIDES = UPPER.name, LOWER.name
_CLEARANCE_ON_SCREEN = 0.12
"""Half the free motion at the tip, drawn as this share of the beam's length."""

_STOP_COLOUR = (205, 205, 205)
_RIBS = 15


@dataclass(frozen=True, slots=True)
class BeamPicture:
    """A beam along x, pinned at 0, its tip between two stops. All in m."""

    rig: ClassVar[str] = "impact_beam"

    length_m: float
    width_m: float
    clearance_m: float
    rest_offset_m: float = 0.0

    @classmethod
    def of(cls, twin: Twin[ImpactBeam, SineDrive]) -> BeamPicture:
        rig = twin.rig
        return cls(rig.beam.length, rig.beam.width, rig.clearance, rig.rest_offset)

    @property
    def magnification(self) -> float:
        """How many times larger than life deflections are drawn."""
        return self.length_m * _CLEARANCE_ON_SCREEN / self.clearance_m

    def views(self, shown: Layout) -> OwnViews:
        """The beam, and where its contact forces are among the channels, their impacts."""
        eye = looking(self.length_m, (0.42, -0.95, 0.3), (0.52, 0.0, 0.0))
        name = f"Predicted beam, {self.magnification:.0f} x"
        view = rrb.Spatial3DView(origin=paths.BEAM, name=name, line_grid=False, eye_controls=eye)
        beam: tuple[rrb.View, float] = (view, 3.0)
        if not any(side in shown.units for side in _SIDES):
            return OwnViews((beam,))
        peaks = over_time(paths.PEAKS, "Largest force of each impact [N]", shown.window_s)
        return OwnViews((beam, (peaks, 2.5)))

    def sketch(self, shown: Layout) -> BeamSketch:
        return BeamSketch(self, shown)

    def play(self, stage: Stage) -> _BeamPlay:
        return _BeamPlay(self, stage)

    def draw_fixed(self, recording: rr.RecordingStream) -> None:
        """Log what does not move: the stops, the pivot, the line of rest."""
        half = (0.02 * self.length_m, 0.8 * self.width_m, 0.006 * self.length_m)
        stops = [sign * self.clearance_m - self.rest_offset_m for sign in (1, -1)]
        heights = [
            self.magnification * stop + sign * half[2] for stop, sign in zip(stops, (1, -1), strict=True)
        ]
        recording.log(
            f"{paths.BEAM}/stops",
            rr.Boxes3D(
                centers=[(self.length_m, 0.0, height) for height in heights],
                half_sizes=[half, half],
                colors=[_STOP_COLOUR],
            ),
            static=True,
        )
        rest = [[(0.0, 0.0, 0.0), (self.length_m, 0.0, 0.0)], _across(0.0, 0.0, 2 * self.width_m)]
        recording.log(
            f"{paths.BEAM}/rest",
            rr.LineStrips3D(rest, colors=[paths.DIM], radii=rr.Radius.ui_points([0.5, 3.0])),
            static=True,
        )

    def draw(self, recording: rr.RecordingStream, deflection_m: NDArray[np.floating]) -> None:
        """Log the beam at the recording's current time, deflected at equal steps from pivot to tip, (n,)."""
        along = np.linspace(0.0, self.length_m, len(deflection_m))
        height = self.magnification * deflection_m
        edges = [
            np.column_stack((along, np.full_like(along, side * self.width_m / 2), height)) for side in (-1, 1)
        ]
        ribs = [
            _across(float(along[at]), float(height[at]), self.width_m)
            for at in np.linspace(0, len(along) - 1, _RIBS).round().astype(int)
        ]
        recording.log(
            f"{paths.BEAM}/shape",
            rr.LineStrips3D(
                [*edges, *ribs],
                colors=[paths.COLOURS["predicted"]],
                radii=rr.Radius.ui_points([2.5, 2.5, *[1.0] * len(ribs)]),
            ),
        )


class BeamSketch:
    """The predicted beam from the side, at the newest phases of the cycle that came, between its stops.

    The forces on these are arrows, measured and predicted.
    """

    def __init__(self, picture: BeamPicture, shown: Layout) -> None:
        self._picture, self._shown = picture, shown
        self._newest: deque[tuple[float, Line]] = deque(maxlen=2 * FRAMES)

    def note(self, shape: Shape, begin_s: float, cycle_s: float) -> None:
        height = self._picture.magnification * np.asarray(shape.points_m, dtype=np.float64)
        line = np.column_stack((np.linspace(0.0, self._picture.length_m, len(height)), height))
        self._newest.append(((shape.time_s - begin_s) / cycle_s % 1.0, line))

    def drawn(self, angles: Mapping[Origin, NDArray[np.floating]]) -> dict[str, Any]:
        """One cycle, put together of several."""
        length, whose = self._picture.length_m, self._shown.whose("predicted")
        phases = np.array([phase for phase, _ in self._newest])
        frames = [
            [(whose, self._newest[int(np.abs((phases - at + 0.5) % 1.0 - 0.5).argmin())][1])]
            for at in np.arange(FRAMES) / FRAMES
            if len(phases)
        ]
        stops = [
            self._picture.magnification * (sign * self._picture.clearance_m - self._picture.rest_offset_m)
            for sign in (1, -1)
        ]
        fixed = [np.array([[0.94 * length, stop], [1.06 * length, stop]]) for stop in stops]
        fixed.append(np.array([[0.0, 0.0], [length, 0.0]]))
        reach = 0.36 * length
        room = (-0.04 * length, -reach, 1.12 * length, reach)
        caption = "stops, slowed; arrows: forces on them"
        if self._shown.origins.get("predicted"):
            large = f"{self._picture.magnification:.0f} x"
            caption = f"{whose} beam, {large}, slowed; arrows: forces on the stops{'' if frames else LATER}"
        ends = [
            (side, (length, stop), sign)
            for side, stop, sign in zip(_SIDES, stops, (1.0, -1.0), strict=True)
            if side in self._shown.units
        ]
        return sketched(caption, fixed, frames, room, ends)


class _BeamPlay:
    """The beam's motion, and the peaks of its impacts."""

    def __init__(self, picture: BeamPicture, stage: Stage) -> None:
        self._picture, self._stage = picture, stage

    def open(self) -> None:
        recording, whose = self._stage.recording, self._stage.shown.whose
        self._picture.draw_fixed(recording)
        for origin, names in self._stage.shown.origins.items():
            if names:
                recording.log(paths.peaks(origin), points_style(whose(origin)), static=True)

    def take(self, record: Record) -> None:
        match record:
            case Impact() if record.channel in _SIDES:
                self._stage.at(self._stage.time_of(record.time_ns))
                self._stage.recording.log(paths.peaks(record.origin), rr.Scalars(record.peak))
            case Shape(time_s, points_m):
                self._stage.at(time_s)
                self._picture.draw(self._stage.recording, points_m)

    def finish(self) -> None:
        """Nothing waits."""


def _across(x: float, z: float, width: float) -> list[tuple[float, float, float]]:
    return [(x, -width / 2, z), (x, width / 2, z)]
