"""The impact beam on the bench (physics.md section 1; Deck and Dubowsky's IBS)."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from rig.rigs.kind import RigKind
from sim_twin.rigs.impact_beam.channels import CHANNELS, LOWER, UPPER, stations_of
from sim_twin.rigs.impact_beam.model import CHECKS, ImpactBeam, SineDrive, nominal

KIND: Final = RigKind(
    parameters=ImpactBeam,
    nominal=nominal,
    drive=SineDrive,
    channels=CHANNELS,
    actuator="signal_generator",
    set_up=("clearance", "rest_offset", "drive_position", "cover", "modes", "elements"),
    by_hand={
        "clearance": "move the two stops: the clearance is half of the tip's free motion",
        "rest_offset": "shift the yoke, so that the tip rests that far from the middle",
        "drive_position": "clamp the shaker's rod there (fraction of the length from the pivot)",
        "beam": "mount that beam",
        "base": "mount the yoke on that base",
        "cover": "mount that cover, or take it off",
    },
    variations=(
        {"frequency": 2.0},
        {"frequency": 0.5},
        {"clearance": 2.0},
        {"amplitude": 1.3},
        {"clearance": 0.5},
    ),
    picture="rig.live.rigs.impact_beam:BeamPicture",
    checks=CHECKS,
    stops=(UPPER.name, LOWER.name),
    lists={"mode_damping": "modal_damping"},
    equipped=lambda rig, channels: replace(rig, stations=stations_of(channels)),
)
