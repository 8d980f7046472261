"""How each rig is shown: a file each, and a row of this table."""

from __future__ import annotations

from typing import Any

from rig.live.rigs.impact_beam import BeamPicture

PICTURES: dict[str, type[Any]] = {picture.rig: picture for picture in (BeamPicture,)}

__all__ = ["PICTURES", "BeamPicture"]
