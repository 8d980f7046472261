"""What a rig's sensors can show: each channel declared once, with what it means."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

from daq.channel import Channel


class Role(Enum):
    """What a channel is to the rig."""

    DRIVE = "drive"
    """What is put in; it counts the cycles where nothing turns."""

    ANGLE = "angle"
    """Of the crank, in rad, not wrapped: counts the cycles."""

    MARKER = "marker"
    """Rises once a revolution, where the bench says: counts the cycles where no angle is shown."""

    SPEED = "speed"
    """Of the shaft."""

    CONTACT = "contact"
    """A force that is positive in compression: above a level there is contact."""

    VIBRATION = "vibration"
    """Something that rings when it is hit: a burst of its magnitude is an impact."""

    RESPONSE = "response"
    """Any other answer of the rig."""


_HOW_IT_MOVES = (Role.ANGLE, Role.MARKER, Role.SPEED)


@dataclass(frozen=True, slots=True)
class RigChannel:
    """A channel called `location.quantity_place`, in `unit` (SI).

    Channels of one `group` are struck together and shown together. What begins within `bounces_s` of a
    contact is a bounce of it; 0 where only one side of a clearance is seen, whose other side comes before the
    next impact. `order_rank`, from 1, is its place among those whose orders are looked at first. `family` is
    what is said of all channels that differ in nothing but their place.
    """

    location: str
    quantity: str
    unit: str
    role: Role = Role.RESPONSE
    place: str = ""
    group: str = ""
    order_rank: int = 0
    family: str = ""
    bounces_s: float = 0.0

    @property
    def name(self) -> str:
        """As scenario, bench and log have it."""
        return f"{self.location}.{self.quantity}" + (f"_{self.place}" if self.place else "")

    @property
    def described(self) -> Channel:
        """As a log describes it, whatever sensor shows it."""
        return Channel(self.name, self.unit, self.quantity, self.location)


class ChannelTable(Mapping[str, RigChannel]):
    """The channels of a rig by name, in the order in which they are told."""

    def __init__(self, channels: Iterable[RigChannel]) -> None:
        self._channels = {each.name: each for each in channels}

    def __getitem__(self, name: str) -> RigChannel:
        return self._channels[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._channels)

    def __len__(self) -> int:
        return len(self._channels)

    def unit(self, name: str) -> str | None:
        """Unit of a channel; None for one that the rig cannot have."""
        return self._channels[name].unit if name in self._channels else None

    def with_role(self, *roles: Role) -> tuple[str, ...]:
        """Names of the channels with the first of `roles`, then those with the next."""
        return tuple(each.name for role in roles for each in self._channels.values() if each.role is role)

    @property
    def told(self) -> tuple[str, ...]:
        """What the rig has, for messages: names, and each family once."""
        return tuple(dict.fromkeys(each.family or each.name for each in self._channels.values()))

    @property
    def drive(self) -> str:
        """The channel of the drive; empty without one."""
        return next(iter(self.with_role(Role.DRIVE)), "")

    @property
    def angle(self) -> str:
        """The channel of the crank's angle; empty without one."""
        return next(iter(self.with_role(Role.ANGLE)), "")

    @property
    def marker(self) -> str:
        """The channel of the marker; empty without one."""
        return next(iter(self.with_role(Role.MARKER)), "")

    @property
    def plain(self) -> frozenset[str]:
        """Those that tell how the rig moves rather than how it vibrates."""
        return frozenset((*self.with_role(*_HOW_IT_MOVES), ENCODER_ANGLE.name))

    @property
    def ordered(self) -> tuple[str, ...]:
        """Those whose orders are looked at first."""
        ranked = [each for each in self._channels.values() if each.order_rank]
        return tuple(each.name for each in sorted(ranked, key=lambda each: each.order_rank))

    def heard(self, channels: Collection[str]) -> dict[str, tuple[str, ...]]:
        """Those of `channels` whose impacts are shown, by their groups."""
        groups: dict[str, tuple[str, ...]] = {}
        for each in self._channels.values():
            if each.group and each.name in channels:
                groups[each.group] = (*groups.get(each.group, ()), each.name)
        return groups


ENCODER_ANGLE = RigChannel("encoder", "angle", "rad", Role.ANGLE)
"""Of an encoder that sends by itself beside the card, at a rate of its own; any rig's crank may have one."""
