"""The live view: measured over predicted while the rig runs, and the same picture of a finished log."""

from rig.live.picture import Picture
from rig.live.rigs import PICTURES, BeamPicture
from rig.live.view import LiveView

__all__ = ["PICTURES", "BeamPicture", "LiveView", "Picture"]
