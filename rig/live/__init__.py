"""The live view: measured over predicted while the rig runs, and the same picture of a finished log."""

from rig.live.beam_picture import BeamPicture
from rig.live.export import rrd_from_log
from rig.live.view import LiveView

__all__ = ["BeamPicture", "LiveView", "rrd_from_log"]
