"""The spatial slider-crank on the bench (physics.md section 3; source: the SSC)."""

from __future__ import annotations

from typing import Final

from rig.rigs.kind import RigKind
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.channels import CHANNELS
from sim_twin.rigs.spatial_slider_crank.model import CHECKS, SpatialSliderCrank, nominal

KIND: Final = RigKind(
    parameters=SpatialSliderCrank,
    nominal=nominal,
    drive=SpeedDrive,
    channels=CHANNELS,
    actuator="inverter",
    set_up=("axis_angle", "socket_clearance", "guide_clearance", "rod_modes"),
    by_hand={
        "axis_angle": "turn the guide to that angle from the crank's axis",
        "socket_clearance": "set the ball joint's clearance (half of the free motion)",
        "guide_clearance": "set the guide's clearance (half of the free motion)",
    },
    variations=({"speed": 1.3}, {"speed": 0.6}),
    picture="rig.live.rigs.spatial_slider_crank:SpatialCrankPicture",
    checks=CHECKS,
    extras=("encoder",),
)
