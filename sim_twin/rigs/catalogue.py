"""The rigs that have a twin; adding one means adding its folder and a line here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pkgutil import resolve_name
from typing import Final

from sim_twin.rigs.rig_model import RigModel
from sim_twin.twin import AnyTwin

_MODELS: Final = {
    "impact_beam": "sim_twin.rigs.impact_beam.rig:MODEL",
    "planar_slider_crank": "sim_twin.rigs.planar_slider_crank.rig:MODEL",
    "spatial_slider_crank": "sim_twin.rigs.spatial_slider_crank.rig:MODEL",
}


class _Rigs(Mapping[str, RigModel]):
    """Each is loaded when it is asked for: nobody has more than one on the bench."""

    def __getitem__(self, name: str) -> RigModel:
        model: RigModel = resolve_name(_MODELS[name])
        return model

    def __iter__(self) -> Iterator[str]:
        return iter(_MODELS)

    def __len__(self) -> int:
        return len(_MODELS)


RIGS: Final = _Rigs()


def model_of(twin: AnyTwin) -> RigModel:
    """The rig that `twin` is of."""
    return next(model for model in RIGS.values() if isinstance(twin.rig, model.parameters))
