"""The rigs whose twin a scenario can name; a new rig is a file here and one line in the table."""

from __future__ import annotations

from collections.abc import Mapping

from rig.twin.rigs import impact_beam, planar_slider_crank, spatial_slider_crank
from rig.twin.rigs.kind import TwinKind
from sim_twin.rigs.catalogue import model_of
from sim_twin.twin import AnyTwin

_KINDS = (impact_beam.KIND, planar_slider_crank.KIND, spatial_slider_crank.KIND)
KINDS: Mapping[str, TwinKind] = {kind.model.name: kind for kind in _KINDS}


def kind_of(twin: AnyTwin) -> TwinKind:
    """The kind that `twin` is of."""
    return KINDS[model_of(twin).name]
