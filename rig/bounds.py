"""What the magnitudes of channels may reach, and which of them has come nearest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

from rig.rigs import declared
from sim_twin.rigs.channel_table import Role

if TYPE_CHECKING:
    from rig.files.scenario import Limit


class Bounds(NamedTuple):
    """What a channel's magnitude may reach, in its unit: full scale, a warning, the end of the run."""

    range: float | None = None
    warning: float | None = None
    abort: float | None = None

    def share(self, level: float) -> float:
        """How much of what ends the run a level is, or of the range where nothing does; 0 without either."""
        most = self.range if self.abort is None else self.abort
        return level / most if most else 0.0

    def said(self, level: float) -> str:
        """The same in words."""
        return f"{100 * self.share(level):.0f} % of its {'range' if self.abort is None else 'limit'}"


def bounds_of(ranges: Mapping[str, float | None], limits: Iterable[Limit]) -> dict[str, Bounds]:
    """Those of the channels with these `ranges`."""
    told = {limit.channel: (limit.warning, limit.abort) for limit in limits}
    return {name: Bounds(full, *told.get(name, (None, None))) for name, full in ranges.items()}


def _always_high(channel: str) -> bool:
    """How far it reaches says nothing, but for a limit: it would hide what a person watches."""
    known = declared(channel)
    return known is not None and known.role in (Role.ANGLE, Role.MARKER, Role.SPEED)


def nearest(levels: Mapping[str, float], bounds: Mapping[str, Bounds]) -> str:
    """The channel whose level has come nearest to what it may reach; empty where none may reach anything."""
    near = {
        name: bounds[name].share(level)
        for name, level in levels.items()
        if name in bounds and (bounds[name].abort is not None or not _always_high(name))
    }
    found = max(near, key=near.__getitem__, default="")
    return found if found and near[found] > 0 else ""
