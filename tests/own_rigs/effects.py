"""Effects whose parameters are named as the numbers of a rig that they change."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.subject import Named
from sim_twin.effects import Parameter

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Rig = TypeVar("Rig", bound="DataclassInstance")


def with_effects(rig: Rig, effects: Iterable[Named]) -> Rig:
    """The rig with the parameters of all effects in it."""
    for _, values in effects:
        rig = replace(rig, **{name: float(value) for name, value in values.items()})
    return rig


def number(name: str, unit: str, *intervals: tuple[float, float]) -> Parameter:
    """A parameter and where it may lie."""
    return Parameter(name, unit, intervals)


def cause(name: str, location: str, *parameters: Parameter, sensing: bool = False) -> Cause:
    """An effect that may be missing; `sensing` if only the sensors show it."""
    return Cause(name, location, parameters, sensing=sensing)
