"""What the live view draws of a twin."""

from __future__ import annotations

from rig.live import BeamPicture
from sim_twin.rigs.impact_beam.model import ImpactBeam
from sim_twin.twin import AnyTwin


def picture_of(twin: AnyTwin) -> BeamPicture | None:
    """The beam in space; None for a rig that has no picture."""
    rig = twin.rig
    if not isinstance(rig, ImpactBeam):
        return None
    return BeamPicture(rig.beam.length, rig.beam.width, rig.clearance, rig.rest_offset)
