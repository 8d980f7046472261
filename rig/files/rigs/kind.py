"""What a scenario needs to know of a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rig.crank.channels import CrankChannels
from rig.files.section import Check


@dataclass(frozen=True, slots=True)
class Highest:
    """What a bench lets its actuator do at most: the `key` of its table, and `of` that table in SI.

    `per_si` is how many of the operator's `unit` one SI unit is.
    """

    key: str
    unit: str
    of: Callable[[Any], float]
    per_si: float = 1.0


@dataclass(frozen=True, slots=True)
class ShownSine:
    """The `channel` that shows a drive that is a sine; `hertz` of the section [drive], None for no sine."""

    channel: str
    hertz: Callable[[Any], float | None]


@dataclass(frozen=True, slots=True)
class RigKind:
    """A rig: the sections of its scenario with the checks over several of their keys, and its channels.

    `bench` is the text of the bench that a run has without a file. `actuator` is the table of a bench that
    drives it, `extras` are tables that it may have besides. `set_up` are the keys of [model] that a lab sets
    between runs on one rig; another value of any other key is another rig. `channels` is what a bench or a
    limit may name, for messages; `channel_unit` gives a channel's unit or None. `drive_frequency` is the
    highest frequency in Hz that the drive holds, from the sound values of [drive], or None; `drive_peak` the
    largest value that the drive asks of its actuator, in SI, and `highest` what a bench allows of it. `sine`
    is there where the drive is a sine whose frequency is held, `crank` where one turns. `by_hand` are the
    keys of [model] that a person changes on the rig between two points of a sweep, each with what to do;
    `contacts` the force channels on which impacts show.
    """

    name: str
    actuator: str
    bench: str
    set_up: tuple[str, ...]
    model: type[Any]
    model_checks: tuple[Check, ...]
    drive: type[Any]
    drive_checks: tuple[Check, ...]
    channels: tuple[str, ...]
    channel_unit: Callable[[str], str | None]
    drive_frequency: Callable[[Mapping[str, Any]], float | None]
    drive_peak: Callable[[Any], float]
    highest: Highest
    by_hand: Mapping[str, str] = field(default_factory=dict)
    contacts: tuple[str, ...] = ()
    extras: tuple[str, ...] = ()
    sine: ShownSine | None = None
    crank: CrankChannels | None = None

    @property
    def turns(self) -> bool:
        """Whether a shaft does, whose speed is held and guarded."""
        return self.crank is not None


def unit_or_none(channel_unit: Callable[[str], str]) -> Callable[[str], str | None]:
    """The unit of a channel by the twin's own table; None instead of a KeyError."""

    def unit(channel: str) -> str | None:
        try:
            return channel_unit(channel)
        except KeyError:
            return None

    return unit
