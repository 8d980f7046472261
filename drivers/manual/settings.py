"""The tables of a bench for what a person sets: [manual_shaker], and [manual_motor] of a rig that turns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal, Self

from daq.quantity import Check, Key, Quantity, Text
from drivers.protocols.instrument import misplaced

_PERSON = Text("where an emulated person listens, such as 127.0.0.1:4711", r"[^\s:]+:\d{1,5}")


def _reachable(manual: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if manual["person"] and (wrong := misplaced(manual["person"])):
        yield "person", wrong


@dataclass(frozen=True, slots=True)
class ManualSettings:
    """Who sets it: a person, or an emulated one at `person`; a run waits `patience_s` for what it asked."""

    driver: Annotated[Literal["manual"], Key()] = "manual"
    person: Annotated[str, _PERSON] = ""
    patience_s: Annotated[float, Quantity("s", 10, 3600, key="patience")] = 300.0
    emulated: Annotated[bool, Key()] = False
    name: str = "manual actuator"
    CHECKS: ClassVar = (Check(("person",), _reachable),)

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        return {"person": address}

    def at(self, address: str) -> Self:
        return replace(self, person=address)


@dataclass(frozen=True, slots=True, kw_only=True)
class ManualShakerSettings(ManualSettings):
    """The table [manual_shaker]: `maximum_amplitude` in N bounds |offset| plus peak at the drive point."""

    maximum_amplitude: Annotated[float, Quantity("N", 0, 1000, above=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ManualMotorSettings(ManualSettings):
    """The table [manual_motor]: `maximum_speed` bounds the crank's."""

    maximum_speed_rpm: Annotated[
        float, Quantity("rpm", 0, 100_000, above=True, kept=True, key="maximum_speed")
    ]

    @property
    def maximum_speed(self) -> float:
        """The highest speed in rad/s."""
        return self.maximum_speed_rpm * math.tau / 60.0
