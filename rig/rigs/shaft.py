"""Which channel of a card shows a shaft turn."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, TypeVar

from rig.rigs import declared
from sim_twin.rigs.channel_table import Role


class NamedChannel(Protocol):
    """A channel, of a bench file, a card or a log."""

    @property
    def name(self) -> str:
        """As its rig declares it."""
        ...


_C = TypeVar("_C", bound=NamedChannel)


def shows_marks(channel: NamedChannel) -> bool:
    """Whether it is a once-per-revolution marker."""
    return _role(channel) is Role.MARKER


def shaft_channel(channels: Iterable[_C]) -> _C | None:
    """The channel that shows the shaft best, an angle before a marker; None where none does."""
    by_role = {_role(channel): channel for channel in reversed(list(channels))}
    return by_role.get(Role.ANGLE) or by_role.get(Role.MARKER)


def _role(channel: NamedChannel) -> Role | None:
    known = declared(channel.name)
    return None if known is None else known.role
