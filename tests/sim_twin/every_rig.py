"""The twins of this project, by the names of their rigs."""

from __future__ import annotations

from sim_twin.rigs.impact_beam.rig import MODEL as IMPACT_BEAM
from sim_twin.rigs.planar_slider_crank.rig import MODEL as PLANAR_SLIDER_CRANK
from sim_twin.rigs.spatial_slider_crank.rig import MODEL as SPATIAL_SLIDER_CRANK

RIGS = {model.name: model for model in (IMPACT_BEAM, PLANAR_SLIDER_CRANK, SPATIAL_SLIDER_CRANK)}
