"""The table on the bench: what drives it, and what a lab may set."""

from __future__ import annotations

from impact_table.model import CHANNELS, ImpactTable, nominal
from rig.rigs.kind import RigKind
from sim_twin.rigs.impact_beam.model import SineDrive

KIND = RigKind(
    parameters=ImpactTable,
    nominal=nominal,
    drive=SineDrive,
    channels=CHANNELS,
    actuator="table_shaker",
    set_up=("gap",),
    by_hand={"gap": "move the stop that far from the resting mass"},
    variations=({"frequency": 1.2}, {"amplitude": 1.3}, {"gap": 2.0}),
    picture="",
    package="impact_table",
)
