"""What is derived from a channel, by its name: the one table."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum


class Watch(Enum):
    """How impacts show in a channel."""

    CONTACT = "contact"
    """A force that is positive in compression: above a level there is contact."""

    VIBRATION = "vibration"
    """Something that rings when it is hit: a burst of its magnitude is an impact."""


@dataclass(frozen=True, slots=True)
class Role:
    """`watch`: how to look for impacts, if at all; channels of one `group` share their levels."""

    watch: Watch | None = None
    group: str = ""
    has_figures: bool = True


_TABLE = (
    (re.compile(r"contact\.force_.*"), Role(Watch.CONTACT, "contact.force")),
    (re.compile(r"slider\.force_[0-9]+"), Role(Watch.CONTACT, "slider.force")),
    (re.compile(r"socket\.force"), Role(Watch.CONTACT, "socket.force")),
    (re.compile(r"yoke\.force"), Role(Watch.VIBRATION)),
    (re.compile(r"(crank|piston)_frame\.acceleration_[xyz]"), Role(Watch.VIBRATION)),
    (re.compile(r".*\.(angle|marker)"), Role(has_figures=False)),
)
_PLAIN = Role()

DRIVE = "drive.force"
ANGLE = "crank.angle"
MARKERS = ("crank.marker", "flywheel.marker")


def role_of(channel: str) -> Role:
    """What is derived from a channel; figures of its cycles where the table says nothing."""
    return next((role for pattern, role in _TABLE if pattern.fullmatch(channel)), _PLAIN)


def reference_of(channels: tuple[str, ...]) -> str | None:
    """The channel that counts the cycles: the encoder rather than a marker, the drive where nothing turns."""
    return next((name for name in (ANGLE, *MARKERS, DRIVE) if name in channels), None)
