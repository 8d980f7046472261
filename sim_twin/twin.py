"""The twin of a bench: the rig, what drives it and its measuring chains."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeAlias, TypeVar

from sim_twin.sensors import Sensor, source_of

if TYPE_CHECKING:
    from sim_twin.healthy import Tolerance
    from sim_twin.rigs.rig_model import RigModel


class Rig(Protocol):
    """The parameters of a rig; `kind` is what a scenario calls it."""

    kind: ClassVar[str]

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that a twin of it predicts."""

    @property
    def model(self) -> RigModel:
        """What is known of all rigs of its kind; loaded when it is asked for."""


RigT = TypeVar("RigT", bound=Rig)
DriveT = TypeVar("DriveT")


@dataclass(frozen=True, slots=True)
class Twin(Generic[RigT, DriveT]):
    """What is simulated; channels without an entry in `sensors` have the ideal analog chain.

    `widths` say, by name, how many times wider than elsewhere a tolerance of this lab's healthy rigs is;
    `besides` are tolerances in which other labs' rigs do not differ at all.
    """

    rig: RigT
    drive: DriveT
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    widths: Mapping[str, float] = field(default_factory=dict)
    besides: tuple[Tolerance, ...] = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the rows of its samples."""
        return self.rig.channels

    @property
    def plugged(self) -> list[int]:
        """Of each channel, the number of the one whose sensor it shows."""
        names = self.channels
        return [names.index(source_of(name, self.sensors.get(name))) for name in names]

    @property
    def model(self) -> RigModel:
        """What is known of all rigs of its kind."""
        return self.rig.model


AnyTwin: TypeAlias = Twin[Any, Any]
Place: TypeAlias = tuple[str, ...]
"""Attributes, keys and positions that lead from a twin to one of its numbers."""


def part_of(whole: Any, name: str) -> Any:
    """The part of a dataclass, mapping or tuple under one step of a place."""
    if isinstance(whole, Mapping):
        return whole[name]
    return whole[int(name)] if isinstance(whole, tuple) else getattr(whole, name)


def changed(whole: Any, new: Mapping[Place, Callable[[Any], Any]]) -> Any:
    """`whole` with what stands at these places made new; what is None on the way or there stays so."""
    steps: dict[str, dict[Place, Callable[[Any], Any]]] = {}
    for (name, *rest), each in new.items():
        steps.setdefault(name, {})[tuple(rest)] = each
    parts = {}
    for name, further in steps.items():
        part, own = part_of(whole, name), further.pop((), None)
        if part is not None:
            part = changed(part, further) if further else part
            parts[name] = part if own is None else own(part)
    if isinstance(whole, Mapping):
        return {**whole, **parts}
    if isinstance(whole, tuple):
        return tuple(parts.get(str(at), part) for at, part in enumerate(whole))
    return replace(whole, **parts) if parts else whole
