"""How each rig is shown: a file each, and a row of this table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rig.live.picture import Picture
from rig.live.rigs.impact_beam import BeamPicture
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.rigs.spatial_slider_crank import SpatialCrankPicture

if TYPE_CHECKING:
    from sim_twin.twin import AnyTwin

PICTURES: dict[str, type[Any]] = {
    picture.rig: picture for picture in (BeamPicture, PlanarCrankPicture, SpatialCrankPicture)
}


def picture_of(rig: str, twin: AnyTwin) -> Picture | None:
    """The rig in space and its own plots, of one of its twins; None for a rig that has no picture."""
    kind = PICTURES.get(rig)
    return None if kind is None else kind.of(twin)
