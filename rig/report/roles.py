"""What the channels of a run are to its rig: the one place where sections of a report ask for them.

A section says what it needs, a shaft that turns or a pair of stops, and never which rig it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rig.rigs import RIGS

UPPER, LOWER = "contact.force_upper", "contact.force_lower"
_UNWRAPPED = ".angle"


@dataclass(frozen=True, slots=True)
class Roles:
    """Names of channels by what they are.

    `angle` is where an encoder tells a shaft's angle, else `marker` does; "" without a shaft. `vibration`
    shows how the rig vibrates rather than how it moves. `unwrapped` are angles that grow as long as a run
    lasts. `stops` are the forces on either side of a play, `impacts` groups of channels whose impacts over
    the shaft's angle are shown together.
    """

    angle: str
    marker: str
    vibration: tuple[str, ...]
    unwrapped: frozenset[str]
    stops: tuple[str, str] | None
    impacts: Mapping[str, tuple[str, ...]]

    @property
    def turns(self) -> bool:
        """Whether a shaft does, so that things are shown over its angle."""
        return bool(self.angle or self.marker)


def roles_of(rig: str, channels: Iterable[str]) -> Roles:
    """The roles of a run's `channels`; of a rig that nobody knows here they are told by their names."""
    names = tuple(channels)
    kind = RIGS.get(rig)
    crank = kind.crank if kind else None
    stops = (UPPER, LOWER) if kind is None or {UPPER, LOWER} <= set(kind.contacts) else None
    return Roles(
        angle=crank.angle if crank else "",
        marker=crank.marker if crank else "",
        vibration=tuple(name for name in names if not crank or name not in crank.plain),
        unwrapped=frozenset(name for name in names if name.endswith(_UNWRAPPED)),
        stops=stops,
        impacts=crank.heard(names) if crank else {},
    )
