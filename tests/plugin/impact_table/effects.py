"""What this package adds to rigs beside their own effects: to its table, and to rattle's beam."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from impact_table.model import scaled
from sim_twin.effects import Effect, Parameter
from sim_twin.twin import AnyTwin


def _worn(twin: AnyTwin, values: Any) -> AnyTwin:
    rig = replace(twin.rig, clearance=twin.rig.clearance + values["depth_m"])
    return replace(twin, rig=rig)


LOOSE_MASS = scaled("loose_mass", "oscillator", "stiffness", (0.5, 0.9))
WORN_STOPS = Effect("worn_stops", "contact joint", (Parameter("depth_m", "m", ((1e-5, 1e-3),)),), _worn)
