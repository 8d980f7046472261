"""What a scenario needs to know of a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rig.files.section import Check


@dataclass(frozen=True, slots=True)
class RigKind:
    """A rig: the sections of its scenario with the checks over several of their keys, and its channels.

    `channels` names what a bench or a limit may name, for messages; `channel_unit` gives a channel's unit or
    None. `drive_frequency` is the highest frequency in Hz that the drive holds, from the sound values of
    [drive], or None; `drive_peak` the largest absolute value that the drive asks of its actuator, in SI.
    """

    name: str
    model: type[Any]
    model_checks: tuple[Check, ...]
    drive: type[Any]
    drive_checks: tuple[Check, ...]
    channels: tuple[str, ...]
    channel_unit: Callable[[str], str | None]
    drive_frequency: Callable[[Mapping[str, Any]], float | None]
    drive_peak: Callable[[Any], float]
