"""The rigs whose twin a scenario can name; a new rig is a file here and one line in the table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pkgutil import resolve_name
from typing import Final

from rig.twin.rigs.kind import TwinKind
from sim_twin.rigs.catalogue import model_of
from sim_twin.twin import AnyTwin

_KINDS: Final = {
    "impact_beam": "rig.twin.rigs.impact_beam:KIND",
    "planar_slider_crank": "rig.twin.rigs.planar_slider_crank:KIND",
    "spatial_slider_crank": "rig.twin.rigs.spatial_slider_crank:KIND",
}


class _Kinds(Mapping[str, TwinKind]):
    """Each is loaded when it is asked for."""

    def __getitem__(self, name: str) -> TwinKind:
        kind: TwinKind = resolve_name(_KINDS[name])
        return kind

    def __iter__(self) -> Iterator[str]:
        return iter(_KINDS)

    def __len__(self) -> int:
        return len(_KINDS)


KINDS: Final = _Kinds()


def kind_of(twin: AnyTwin) -> TwinKind:
    """The kind that `twin` is of."""
    return KINDS[model_of(twin).name]
