"""Which channel phase and mean frequency are taken from, and how."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from typing import Any, Final

from numpy.typing import NDArray

from rig.twin.alignment import Alignment, align
from rig.twin.crank_alignment import MARKED_TURNS, align_angle, align_marker
from sim_twin.rigs.channel_table import ChannelTable, Role

Align = Callable[[NDArray[Any], float, int, Any], Alignment]
_ALIGNED: Final[Mapping[Role, tuple[Align, float]]] = {
    Role.ANGLE: (align_angle, 0.0),
    Role.MARKER: (align_marker, MARKED_TURNS),
    Role.DRIVE: (align, 0.0),
}
"""The best first, each with the cycles that it needs."""


@dataclass(frozen=True, slots=True)
class Reference:
    """A channel that phase and mean frequency are taken from.

    `align(values, sample rate, first sample, drive)` takes them; it needs `cycles` of the drive or turns.
    """

    channel: str
    align: Align
    cycles: float = 0.0


def reference_among(table: ChannelTable, channels: Container[str]) -> Reference:
    """The best reference of a rig that is among `channels`; the best of all where none is."""
    names = table.with_role(*_ALIGNED)
    name = next((each for each in names if each in channels), names[0])
    return Reference(name, *_ALIGNED[table[name].role])
