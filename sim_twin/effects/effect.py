"""What an effect is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sim_twin.rigs.impact_beam.twin import BeamTwin

ParameterValues = Mapping[str, float | str]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number with its unit and the intervals in which a rig may plausibly lie."""

    name: str
    unit: str
    intervals: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Effect:
    """One cause: its `location`, its parameters (the main one first) and what it changes in a twin.

    `channels` are those that a sensor or clock effect may sit on; empty for effects of the rig itself.
    `applies` is False for a twin that cannot have it (a friction torque at a clamp).
    """

    name: str
    location: str
    parameters: tuple[Parameter, ...]
    change: Callable[[BeamTwin, ParameterValues], BeamTwin]
    channels: tuple[str, ...] = ()
    applies: Callable[[BeamTwin], bool] = lambda _: True
