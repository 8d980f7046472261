"""What an effect is: something that the nominal twin leaves out or has wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from daq.plugins import OpenTable
from sim_twin.twin import AnyTwin

ParameterValues: TypeAlias = Mapping[str, float | str]
Coordinates: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number with its unit and the intervals (ends included) in which a rig may plausibly lie.

    `whole`: where it is guessed, only whole numbers are. One with `words` is one of them instead.
    """

    name: str
    unit: str = ""
    intervals: tuple[tuple[float, float], ...] = ()
    whole: bool = False
    words: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """The intervals with their unit, or the words, for people."""
        if self.words:
            return f"one of {', '.join(self.words)}"
        ranges = " or ".join(f"{low:g} to {high:g}" for low, high in self.intervals)
        return f"{ranges} {self.unit}".rstrip()

    def holds(self, value: object) -> bool:
        """Whether `value` is allowed."""
        if self.words:
            return value in self.words
        return isinstance(value, float) and any(low <= value <= high for low, high in self.intervals)


@dataclass(frozen=True, slots=True)
class Effect:
    """One cause: its `location`, its parameters (the main one first) and what it changes in a twin.

    `channels` are those that the effect may sit on; empty for effects that sit on none. `refusal` says why
    a twin cannot have it (a friction torque at a clamp), or nothing; `together` what is wrong with parameters
    that are fine one by one. `sensing` effects change what is shown, not what moves. `coordinates` takes
    parameters (n, parameters) to (n, any), in which responses are nearly straight; None: each by itself is.
    """

    name: str
    location: str
    parameters: tuple[Parameter, ...]
    change: Callable[[Any, ParameterValues], Any]
    channels: tuple[str, ...] = ()
    refusal: Callable[[Any], str] = lambda _: ""
    together: Callable[[ParameterValues], str] = lambda _: ""
    sensing: bool = False
    coordinates: Coordinates | None = None

    @property
    def asked(self) -> Mapping[str, Parameter]:
        """All that has to be said of it, by name: its parameters, and the channel that it sits on."""
        channel = (Parameter("channel", words=self.channels),) if self.channels else ()
        return {each.name: each for each in (*self.parameters, *channel)}

    def apply(self, twin: AnyTwin, values: ParameterValues) -> AnyTwin:
        """Return `twin` with the effect in; raises ValueError for what it cannot have or be."""
        reason = self.refusal(twin)
        if reason:
            raise ValueError(f"{self.name} does not exist on this rig ({reason})")
        self._check(twin, values)
        changed: AnyTwin = self.change(twin, values)
        return changed

    def _check(self, twin: AnyTwin, values: ParameterValues) -> None:
        expected = [*(["channel"] if self.channels else []), *(each.name for each in self.parameters)]
        if set(values) != set(expected):
            raise ValueError(f"{self.name} takes exactly {', '.join(expected)}, not {', '.join(values)}")
        if self.channels and values["channel"] not in twin.channels:
            raise ValueError(f"{self.name}: this rig has no channel {values['channel']}")
        if self.channels and values["channel"] not in self.channels:
            raise ValueError(
                f"{self.name} sits on one of {', '.join(self.channels)}, not {values['channel']}"
            )
        for parameter in self.parameters:
            value = float(values[parameter.name])
            if not parameter.holds(value):
                raise ValueError(f"{self.name}.{parameter.name} = {value:g}: {parameter.allowed}")
        wrong = self.together(values)
        if wrong:
            raise ValueError(f"{self.name}: {wrong}")


Catalogue: TypeAlias = Mapping[str, Effect]


def catalogue_of(rig: str, effects: Iterable[Effect]) -> Catalogue:
    """The effects of a rig by name, and those that other packages add to it in the group `rattle.effects`."""
    return OpenTable({effect.name: effect for effect in effects}, "rattle.effects", Effect, owner=rig)


def apply_effects(
    catalogue: Catalogue, twin: AnyTwin, effects: Iterable[tuple[str, ParameterValues]]
) -> AnyTwin:
    """Return `twin` with the named effects in, in the order given.

    Raises ValueError for an effect that the rig cannot have or a parameter outside its range.
    """
    for name, values in effects:
        if name not in catalogue:
            raise ValueError(f"no effect {name!r}; known: {', '.join(catalogue)}")
        twin = catalogue[name].apply(twin, values)
    return twin
