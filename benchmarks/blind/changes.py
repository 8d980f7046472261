"""Puts effects into a rig, whatever the rig is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar

Rig = TypeVar("Rig")
Values: TypeAlias = Mapping[str, Any]
Effects: TypeAlias = Sequence[Mapping[str, Any]]


def changed(rig: Rig, effects: Effects, changes: Mapping[str, Callable[[Rig, Values], Rig]]) -> Rig:
    """The rig with every effect that `changes` knows."""
    for effect in effects:
        if effect["name"] in changes:
            rig = changes[effect["name"]](rig, effect["parameters"])
    return rig


def refuse_unknown(effects: Effects, known: Iterable[str]) -> None:
    """Raise ValueError where `effects` holds one that is not `known`."""
    unknown = sorted({str(effect["name"]) for effect in effects} - set(known))
    if unknown:
        raise ValueError(f"effects that this rig does not have: {', '.join(unknown)}")
