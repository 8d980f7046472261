"""The spatial slider-crank in space: crank, rod, slider; ball in its socket, slider on its guide."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.live.crank_picture import CrankPicture
from rig.live.mechanism import SQUARE, Bar, Body, Box, Joint, Pose, Solid, turned_to
from rig.live.picture import Point
from sim_twin.rigs.channel_table import ChannelTable
from sim_twin.rigs.spatial_slider_crank.channels import CHANNELS

if TYPE_CHECKING:
    from sim_twin.rigs.crank_drive import SpeedDrive
    from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
    from sim_twin.twin import Twin

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class SpatialCrankPicture(CrankPicture):
    """Guide along x, z up, the crank's circle spanned by z and the horizontal across its axis. SI."""

    rig: ClassVar[str] = "spatial_slider_crank"
    seen: ClassVar[tuple[Point, Point, Point]] = (0.3, -0.9, 0.4), (0.48, 0.0, 0.0), (0.0, 0.0, 1.0)
    channels: ClassVar[ChannelTable] = CHANNELS

    crank_m: float
    rod_m: float
    rod_radius_m: float
    axis_angle_rad: float
    pin_m: tuple[float, float, float]
    guide_half_side_m: float
    contact_span_m: float
    socket_clearance_m: float
    guide_clearance_m: float
    speed_rad_s: float
    marker_angle_rad: float = 0.0

    @classmethod
    def of(cls, twin: Twin[SpatialSliderCrank, SpeedDrive]) -> SpatialCrankPicture:
        rig = twin.rig
        return cls(
            crank_m=rig.crank_radius,
            rod_m=rig.rod.length,
            rod_radius_m=rig.rod.diameter / 2,
            axis_angle_rad=rig.axis_angle,
            pin_m=rig.slider.pin,
            guide_half_side_m=rig.guide_half_side,
            contact_span_m=rig.contact_span,
            socket_clearance_m=rig.socket_clearance,
            guide_clearance_m=rig.guide_clearance,
            speed_rad_s=twin.drive.mean_speed,
            marker_angle_rad=rig.marker_angle,
        )

    def fixed(self) -> tuple[Solid, ...]:
        """The guide along the stroke, and the crank's axle."""
        half = self.guide_half_side_m
        reach = self.crank_m * sin(self.axis_angle_rad) + 1.6 * self.contact_span_m
        axle = tuple(float(each) for each in 0.6 * self.crank_m * self._axis + self._centre)
        start = tuple(float(each) for each in 0.16 * self.crank_m * self._axis + self._centre)
        guide = Box((self.rod_m, 0.0, 0.0), (reach, half, half), clear=True)
        return guide, Bar((start[0], start[1], start[2]), (axle[0], axle[1], axle[2]), 0.14 * self.crank_m)

    def bodies(self) -> tuple[Body, ...]:
        r, L, thick = self.crank_m, self.rod_m, self.rod_radius_m
        behind = 0.16 * r
        web = Bar((0.0, behind, 0.0), (r, behind, 0.0), 0.11 * r)
        socket = Bar((r, 0.0, 0.0), (r, behind, 0.0), 2.0 * thick)
        rod = Bar((0.0, 0.0, 0.0), (L, 0.0, 0.0), thick)
        half = (1.15 * self.contact_span_m, 1.9 * self.guide_half_side_m, 1.9 * self.guide_half_side_m)
        at = tuple(-each for each in self.pin_m)
        shell = Box((at[0], at[1], at[2]), half, clear=True)
        outline = tuple((at[0] + x * half[0], at[1], at[2] + z * half[2]) for x, z in SQUARE)
        return (
            Body("crank", (web, socket), ((0.0, 0.0, 0.0), (r, 0.0, 0.0))),
            Body("rod", (rod,), ((0.0, 0.0, 0.0), (L, 0.0, 0.0))),
            Body("slider", (shell,), outline),
        )

    def poses(self, angle: NDArray[np.float64]) -> tuple[Pose, ...]:
        toward = np.array([sin(self.axis_angle_rad), -cos(self.axis_angle_rad), 0.0])
        radial = np.outer(np.cos(angle), toward) + np.outer(np.sin(angle), _UP)
        ball = self._centre + self.crank_m * radial
        pin = np.broadcast_to(self._centre, ball.shape).copy()
        across = ball - pin
        pin[:, 0] = ball[:, 0] + np.sqrt(self.rod_m**2 - across[:, 1] ** 2 - across[:, 2] ** 2)
        axis = np.broadcast_to(self._axis, radial.shape)
        crank = np.stack((radial, axis, np.cross(radial, axis)), axis=2)
        straight = np.broadcast_to(np.eye(3), (len(angle), 3, 3))
        centre = np.broadcast_to(self._centre, ball.shape)
        return (
            Pose(centre, crank),
            Pose(ball, turned_to((pin - ball) / self.rod_m, _UP)),
            Pose(pin, straight),
        )

    def joints(self) -> tuple[Joint, ...]:
        """The ball from above and from the side, and the slider seen along the guide."""
        return (
            Joint("ball in socket", self.socket_clearance_m, "x", "y"),
            Joint("ball in socket", self.socket_clearance_m, "x", "z"),
            Joint("slider on guide", self.guide_clearance_m, "y", "z", round=False),
        )

    def eccentricity(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Shape (3, 2), of crank bearing, socket, ball and universal joint."""
        centre, socket, ball, pin = points_m.astype(np.float64)
        offset, off_guide = ball - socket, pin - centre
        return np.array([offset[[0, 1]], offset[[0, 2]], off_guide[[1, 2]]])

    @property
    def _centre(self) -> NDArray[np.float64]:
        """The crank's centre; with centred joints the pin moves along x through it."""
        return np.array([0.0, self.pin_m[1], self.pin_m[2]])

    @property
    def _axis(self) -> NDArray[np.float64]:
        """The crank's axis, towards the motor."""
        return np.array([cos(self.axis_angle_rad), sin(self.axis_angle_rad), 0.0])
