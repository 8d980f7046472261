"""The twin of a bench: the rig, what drives it and its measuring chains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from sim_twin.sensors import Sensor


class Rig(Protocol):
    """The parameters of a rig."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that a twin of it predicts."""


RigT = TypeVar("RigT", bound=Rig)
DriveT = TypeVar("DriveT")


@dataclass(frozen=True, slots=True)
class Twin(Generic[RigT, DriveT]):
    """What is simulated; channels without an entry in `sensors` have the ideal analog chain."""

    rig: RigT
    drive: DriveT
    sensors: Mapping[str, Sensor] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows of its samples."""
        return self.rig.channels


AnyTwin: TypeAlias = Twin[Any, Any]
