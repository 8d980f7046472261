"""The planar slider-crank in its plane: crank, rod and piston, and the two pins in their bearings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.live.crank_picture import CrankPicture
from rig.live.mechanism import SQUARE, Bar, Body, Box, Joint, Pose, Solid, turned_to
from rig.live.picture import Point
from sim_twin.rigs.channel_table import ChannelTable
from sim_twin.rigs.planar_slider_crank.channels import CHANNELS

if TYPE_CHECKING:
    from sim_twin.rigs.crank_drive import SpeedDrive
    from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
    from sim_twin.twin import Twin

_SIDE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class PlanarCrankPicture(CrankPicture):
    """Crank around the origin, slider along +x, gravity along -y. In m and rad/s."""

    rig: ClassVar[str] = "planar_slider_crank"
    seen: ClassVar[tuple[Point, Point, Point]] = (0.45, 0.2, 0.85), (0.52, 0.0, 0.0), (0.0, 1.0, 0.0)
    channels: ClassVar[ChannelTable] = CHANNELS

    crank_m: float
    rod_m: float
    clearance_1_m: float
    clearance_2_m: float
    speed_rad_s: float
    marker_angle_rad: float = 0.0

    @classmethod
    def of(cls, twin: Twin[PlanarSliderCrank, SpeedDrive]) -> PlanarCrankPicture:
        rig, gaps = twin.rig, (twin.rig.clearance_1, twin.rig.clearance_2)
        return cls(rig.crank_length, rig.rod_length, *gaps, twin.drive.mean_speed, rig.marker_angle)

    def fixed(self) -> tuple[Solid, ...]:
        """The crank's bearing, and the guide's two rails along the stroke."""
        r, size = self.crank_m, self._size
        middle, half = self.rod_m, (r + 2.5 * size, 0.25 * size, 1.2 * size)
        rails = tuple(Box((middle, side * 1.75 * size, 0.0), half) for side in (-1, 1))
        return (Box((0.0, -1.6 * size, -1.3 * size), (1.1 * size, 1.6 * size, 0.3 * size)), *rails)

    def bodies(self) -> tuple[Body, ...]:
        r, L, size = self.crank_m, self.rod_m, self._size
        bearing, pin = (0.0, 0.0, 0.0), (r, 0.0, 0.0)
        shaft = Bar((0.0, 0.0, -1.5 * size), (0.0, 0.0, 0.3 * size), 0.55 * size)
        journal = Bar((r, 0.0, -0.6 * size), (r, 0.0, 0.9 * size), 0.4 * size)
        web = Bar((0.0, 0.0, -0.6 * size), (r, 0.0, -0.6 * size), 0.5 * size)
        rod = Bar((0.0, 0.0, 0.3 * size), (L, 0.0, 0.3 * size), 0.33 * size)
        piston = Box((0.0, 0.0, 0.0), (2.0 * size, 1.45 * size, 1.0 * size), clear=True)
        return (
            Body("crank", (web, shaft, journal), (bearing, pin)),
            Body("rod", (rod,), (bearing, (L, 0.0, 0.0))),
            Body("piston", (piston,), tuple((2.0 * size * x, 1.45 * size * y, 0.0) for x, y in SQUARE)),
        )

    def poses(self, angle: NDArray[np.float64]) -> tuple[Pose, ...]:
        nothing = np.zeros_like(angle)
        pin = self.crank_m * np.column_stack((np.cos(angle), np.sin(angle), nothing))
        along = np.sqrt(self.rod_m**2 - pin[:, 1] ** 2)
        piston = np.column_stack((pin[:, 0] + along, nothing, nothing))
        straight = np.broadcast_to(np.eye(3), (len(angle), 3, 3))
        return (
            Pose(np.zeros_like(pin), turned_to(pin / self.crank_m, _SIDE)),
            Pose(pin, turned_to((piston - pin) / self.rod_m, _SIDE)),
            Pose(piston, straight),
        )

    def joints(self) -> tuple[Joint, ...]:
        return (
            Joint("crank pin", self.clearance_1_m, "x", "y"),
            Joint("piston pin", self.clearance_2_m, "x", "y"),
        )

    def eccentricity(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Journal less bearing, shape (2, 2), of bearing, crank pin, the rod's ends, piston pin."""
        _, crank_pin, near, far, piston_pin = points_m.astype(np.float64)
        return np.array([crank_pin - near, piston_pin - far])

    @property
    def _size(self) -> float:
        """Half the thickness of things, m."""
        return 0.2 * self.crank_m
