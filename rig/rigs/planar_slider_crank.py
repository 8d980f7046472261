"""The planar slider-crank on the bench (physics.md section 2; Erkaya's rig)."""

from __future__ import annotations

from typing import Final

from rig.rigs.kind import RigKind
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.channels import CHANNELS
from sim_twin.rigs.planar_slider_crank.model import CHECKS, PlanarSliderCrank, nominal

KIND: Final = RigKind(
    parameters=PlanarSliderCrank,
    nominal=nominal,
    drive=SpeedDrive,
    channels=CHANNELS,
    actuator="inverter",
    set_up=("clearance_1", "clearance_2"),
    by_hand={
        "clearance_1": "fit the crank pin with that radial clearance",
        "clearance_2": "fit the piston pin with that radial clearance",
        "material": "mount the links of that material",
    },
    variations=({"speed": 1.5}, {"speed": 0.6}, {"speed": 1.25}, {"speed": 0.8}),
    picture="rig.live.rigs.planar_slider_crank:PlanarCrankPicture",
    checks=CHECKS,
    extras=("encoder",),
)
