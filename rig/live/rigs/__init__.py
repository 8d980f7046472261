"""How each rig is shown: a file each, and a row of this table."""

from __future__ import annotations

from typing import Any

from rig.live.rigs.impact_beam import BeamPicture
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.rigs.spatial_slider_crank import SpatialCrankPicture

PICTURES: dict[str, type[Any]] = {
    picture.rig: picture for picture in (BeamPicture, PlanarCrankPicture, SpatialCrankPicture)
}
