"""Which channel of a card shows a shaft turn."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, TypeVar


class NamedChannel(Protocol):
    """A channel, of a bench file, a card or a log: its name and its unit."""

    @property
    def name(self) -> str:
        """Where it is and what it shows: `crank.angle`."""
        ...

    @property
    def unit(self) -> str:
        """Unit of its samples."""
        ...


_C = TypeVar("_C", bound=NamedChannel)


def shows_angle(channel: NamedChannel) -> bool:
    """Whether it is an angle on a counter."""
    return channel.name.endswith(".angle") and channel.unit == "rad"


def shows_marks(channel: NamedChannel) -> bool:
    """Whether it is a once-per-revolution marker."""
    return channel.name.endswith(".marker") and channel.unit == "V"


def shaft_channel(channels: Iterable[_C]) -> _C | None:
    """The channel that shows the shaft best, an angle before a marker; None where none does."""
    channels = list(channels)
    candidates = [*filter(shows_angle, channels), *filter(shows_marks, channels)]
    return next(iter(candidates), None)
