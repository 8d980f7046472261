"""The rigs that have a twin; adding one means adding its folder and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from sim_twin.rigs.impact_beam.rig import MODEL as IMPACT_BEAM
from sim_twin.rigs.planar_slider_crank.rig import MODEL as PLANAR_SLIDER_CRANK
from sim_twin.rigs.rig_model import RigModel
from sim_twin.rigs.spatial_slider_crank.rig import MODEL as SPATIAL_SLIDER_CRANK
from sim_twin.twin import AnyTwin

_MODELS = (IMPACT_BEAM, PLANAR_SLIDER_CRANK, SPATIAL_SLIDER_CRANK)
RIGS: Mapping[str, RigModel] = {model.name: model for model in _MODELS}


def model_of(twin: AnyTwin) -> RigModel:
    """The rig that `twin` is of."""
    return twin.model
