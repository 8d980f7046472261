"""The beam in space, its deflection enlarged until the clearance can be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from rig.live import paths

_CLEARANCE_ON_SCREEN = 0.12
"""Half the free motion at the tip, drawn as this share of the beam's length."""

_STOP_COLOUR = (205, 205, 205)
_RIBS = 15


@dataclass(frozen=True, slots=True)
class BeamPicture:
    """What the 3D view shows: a beam along x, pinned at 0, its tip between two stops. All in m."""

    length_m: float
    width_m: float
    clearance_m: float
    rest_offset_m: float = 0.0

    @property
    def magnification(self) -> float:
        """How many times larger than life deflections are drawn."""
        return self.length_m * _CLEARANCE_ON_SCREEN / self.clearance_m

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

    def draw(
        self,
        recording: rr.RecordingStream,
        positions_m: NDArray[np.floating],
        deflection_m: NDArray[np.floating],
    ) -> None:
        """Log the beam as it is at the recording's current time; both arrays of shape (n,)."""
        height = self.magnification * deflection_m
        edges = [
            np.column_stack((positions_m, np.full_like(positions_m, side * self.width_m / 2), height))
            for side in (-1, 1)
        ]
        ribs = [
            _across(float(positions_m[at]), float(height[at]), self.width_m)
            for at in np.linspace(0, len(positions_m) - 1, _RIBS).round().astype(int)
        ]
        recording.log(
            f"{paths.BEAM}/shape",
            rr.LineStrips3D(
                [*edges, *ribs],
                colors=[paths.COLOURS["predicted"]],
                radii=rr.Radius.ui_points([2.5, 2.5, *[1.0] * len(ribs)]),
            ),
        )


def _across(x: float, z: float, width: float) -> list[tuple[float, float, float]]:
    return [(x, -width / 2, z), (x, width / 2, z)]
