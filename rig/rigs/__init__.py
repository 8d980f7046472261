"""The rigs: a module each, and a line in the one table; or an entry point in the group `rattle.rigs`."""

from __future__ import annotations

import functools
from collections.abc import Iterable

from daq.plugins import OpenTable
from rig.rigs.kind import RigKind
from sim_twin.rigs.channel_table import ENCODER_ANGLE, RigChannel, Role

RIGS = OpenTable[RigKind](
    {
        "impact_beam": "rig.rigs.impact_beam:KIND",
        "planar_slider_crank": "rig.rigs.planar_slider_crank:KIND",
        "spatial_slider_crank": "rig.rigs.spatial_slider_crank:KIND",
    },
    "rattle.rigs",
    RigKind,
)


@functools.cache
def declared(channel: str) -> RigChannel | None:
    """What a channel is declared to be, of any rig or beside its card; None where nobody has it."""
    if channel == ENCODER_ANGLE.name:
        return ENCODER_ANGLE
    return next((kind.channels[channel] for kind in RIGS.values() if channel in kind.channels), None)


def unit_of(channel: str) -> str | None:
    """Unit of a channel of any rig's card; None if no rig has it."""
    units = (kind.channels.unit(channel) for kind in RIGS.values())
    return next((unit for unit in units if unit is not None), None)


def channel_names() -> tuple[str, ...]:
    """Names of the channels of all rigs, in the operator's words."""
    return tuple(name for kind in RIGS.values() for name in kind.channels.told)


def shows_marks(channel: str) -> bool:
    """Whether a channel of this name is a once-per-revolution marker."""
    return _has(channel, Role.MARKER)


def shows_speed(channel: str) -> bool:
    """Whether a channel of this name is a tachometer."""
    return _has(channel, Role.SPEED)


def _has(channel: str, role: Role) -> bool:
    known = declared(channel)
    return known is not None and known.role is role


def shaft_channel(channels: Iterable[str]) -> str | None:
    """The channel that shows the shaft best, an angle before a marker; None where none does."""
    known = {name: each.role for name in channels if (each := declared(name)) is not None}
    angles = (name for name, role in known.items() if role is Role.ANGLE)
    return next(angles, next(filter(shows_marks, known), None))
