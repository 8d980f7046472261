"""The rigs that a scenario can name; a new rig is a file here and one line in the table."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rig.files.rigs import impact_beam, planar_slider_crank, spatial_slider_crank
from rig.files.rigs.kind import RigKind

RIGS: Mapping[str, RigKind] = MappingProxyType(
    {kind.name: kind for kind in (impact_beam.KIND, planar_slider_crank.KIND, spatial_slider_crank.KIND)}
)


def unit_of(channel: str) -> str | None:
    """Unit of a channel of any rig; None if no rig has it."""
    units = (kind.channel_unit(channel) for kind in RIGS.values())
    return next((unit for unit in units if unit is not None), None)


def channel_names() -> tuple[str, ...]:
    """Names of the channels of all rigs, in the operator's words."""
    return tuple(name for kind in RIGS.values() for name in kind.channels)
