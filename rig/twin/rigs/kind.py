"""What joins a scenario with the twin of its rig."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, fields
from typing import Any

from numpy.typing import NDArray

from rig.twin.alignment import Alignment
from sim_twin.rigs.rig_model import RigModel
from sim_twin.twin import AnyTwin

Align = Callable[[NDArray[Any], float, int, Any], Alignment]


@dataclass(frozen=True, slots=True)
class Reference:
    """A channel that phase and mean frequency are taken from.

    `align(values, sample rate, first sample, drive)` takes them; it needs `cycles` of the drive or turns.
    """

    channel: str
    align: Align
    cycles: float = 0.0


@dataclass(frozen=True, slots=True)
class TwinKind:
    """A rig's twin from a scenario, and in step with a measurement.

    `build(model section, drive section, channel names)` makes the nominal twin. `references` are what phase
    and mean frequency can be taken from, the best first. `in_step(drive, alignment)` is the drive at the
    measured frequency, `phase_at(that drive, alignment, time)` its phase or crank angle (rad) at `time` s
    since sample 0; `untouched(drive)` the alignment where nothing was measured. `variations` are settings
    that a bench can change, as factors of scenario keys.
    """

    model: RigModel
    build: Callable[[Any, Any, tuple[str, ...]], AnyTwin]
    references: tuple[Reference, ...]
    in_step: Callable[[Any, Alignment], Any]
    phase_at: Callable[[Any, Alignment, float], float]
    untouched: Callable[[Any], Alignment]
    variations: tuple[Mapping[str, float], ...]

    def reference(self, channels: Container[str]) -> Reference:
        """The best of those among `channels`; the best of all where none is."""
        return next((each for each in self.references if each.channel in channels), self.references[0])


def given(section: Any) -> dict[str, Any]:
    """The keys of a scenario's section that the operator has set."""
    values = {field.name: getattr(section, field.name) for field in fields(section)}
    return {name: value for name, value in values.items() if value is not None}
