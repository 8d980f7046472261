"""What the live view draws of a twin."""

from __future__ import annotations

from rig.live.picture import Picture
from rig.live.rigs import PICTURES
from sim_twin.rigs.catalogue import model_of
from sim_twin.twin import AnyTwin


def picture_of(twin: AnyTwin) -> Picture | None:
    """The rig in space and its own plots; None for a rig that has no picture."""
    kind = PICTURES.get(model_of(twin).name)
    return None if kind is None else kind.of(twin)
