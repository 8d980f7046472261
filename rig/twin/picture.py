"""What the live view draws of a twin."""

from __future__ import annotations

from rig.live.picture import Picture
from rig.loaded_table import loaded
from rig.rigs import RIGS
from sim_twin.twin import AnyTwin


def picture_of(twin: AnyTwin) -> Picture | None:
    """The rig in space and its own plots; None for a rig that has no picture."""
    place = RIGS[twin.rig.kind].picture
    picture: Picture | None = loaded(place).of(twin) if place else None
    return picture
