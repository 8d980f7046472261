"""What may be behind a gap: an effect, on a channel where it needs one, and its prior."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import log, pi
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.subject import Named
from sim_twin.effects import Coordinates, Parameter

Array = NDArray[np.float64]
_WIDE = 3.0
"""Ratio of a range's ends from which on it is searched by its logarithm."""
_TRIES = 1000


def _always(_: Mapping[str, float | str]) -> bool:
    return True


@dataclass(frozen=True, slots=True)
class Cause:
    """One effect of a catalogue, on `channel` where it sits on one.

    `sensing`: it only changes what the sensors show, not the motion. `allows` says which parameters may go
    together. Parameters are searched as places u in a unit cube, over which they are equally likely.
    `nearly_straight`: see the coordinates of an `Effect`. `entered`: no effect, but a value that may have
    been entered wrongly.
    """

    name: str
    location: str
    parameters: tuple[Parameter, ...]
    channel: str | None = None
    sensing: bool = False
    allows: Callable[[Mapping[str, float | str]], bool] = field(default=_always, compare=False)
    nearly_straight: Coordinates | None = field(default=None, compare=False)
    entered: bool = False

    def values(self, u: Array) -> Array:
        """Parameters at places `u`, shape (n, parameters) to the same."""
        return np.column_stack([_value(p, u[:, k]) for k, p in enumerate(self.parameters)])

    def places(self, values: Array) -> Array:
        """Places of parameters: the inverse of `values`."""
        return np.column_stack([_place(p, values[:, k]) for k, p in enumerate(self.parameters)])

    def coordinates(self, values: Array) -> Array:
        """Coordinates in which responses are smooth, shape (n, parameters or more)."""
        if self.nearly_straight is not None:
            return self.nearly_straight(values)
        columns: list[Array] = []
        for parameter, value in zip(self.parameters, values.T, strict=True):
            low, high = parameter.intervals[0][0], parameter.intervals[-1][1]
            if parameter.unit == "rad":
                columns += [np.cos(value), np.sin(value)]
            elif low > 0 and _logarithmic(low, high):
                columns.append(np.log(value))
            elif low < 0 < high and len(parameter.intervals) > 1:
                nearest = min(abs(end) for interval in parameter.intervals for end in interval)
                columns.append(np.sign(value) * (0.5 + np.log(np.abs(value) / nearest)))
            else:
                columns.append(value)
        return np.column_stack(columns)

    def named(self, values: Array) -> Named:
        """The effect as a twin takes it; `values` has shape (parameters,)."""
        given: dict[str, float | str] = {
            p.name: float(value) for p, value in zip(self.parameters, values, strict=True)
        }
        return self.name, given if self.channel is None else {"channel": self.channel, **given}

    def allowed(self, values: Array) -> NDArray[np.bool_]:
        """Which rows of parameters may go together."""
        return np.array([self.allows(self.named(row)[1]) for row in values], dtype=bool)


Hypothesis: TypeAlias = tuple[Cause, ...]
"""What is there at the same time; nothing: ()."""


def effects_of(hypothesis: Hypothesis) -> Hypothesis:
    """It without values that were entered wrongly."""
    return tuple(cause for cause in hypothesis if not cause.entered)


def is_effect(hypothesis: Hypothesis) -> bool:
    """Whether it is one effect alone."""
    return len(hypothesis) == 1 and not hypothesis[0].entered


def parts_of(hypothesis: Hypothesis) -> list[slice]:
    """Where each cause's parameters lie in a row of the hypothesis."""
    ends = np.cumsum([len(cause.parameters) for cause in hypothesis])
    return [slice(end - len(cause.parameters), end) for cause, end in zip(hypothesis, ends, strict=True)]


def values_of(hypothesis: Hypothesis, u: Array) -> Array:
    """Parameters of all causes at places `u`, shape (n, parameters)."""
    parts = zip(hypothesis, parts_of(hypothesis), strict=True)
    return np.concatenate([np.zeros((len(u), 0)), *(cause.values(u[:, at]) for cause, at in parts)], axis=1)


def places_of(hypothesis: Hypothesis, values: Array) -> Array:
    """Places in the unit cube of parameters (n, parameters): the inverse of `values_of`."""
    parts = zip(hypothesis, parts_of(hypothesis), strict=True)
    return np.concatenate([np.zeros((len(values), 0)), *(c.places(values[:, at]) for c, at in parts)], axis=1)


def allowed_by(hypothesis: Hypothesis, values: Array) -> NDArray[np.bool_]:
    """Which rows of parameters may be."""
    allowed = np.ones(len(values), dtype=bool)
    for cause, at in zip(hypothesis, parts_of(hypothesis), strict=True):
        if len(cause.parameters) > 1 and cause.allows is not _always:
            allowed &= cause.allowed(values[:, at])
    return allowed


def drawn(hypothesis: Hypothesis, count: int, rng: np.random.Generator) -> Array:
    """Parameters from the prior, spread evenly over it, shape (count, parameters)."""
    size = sum(len(cause.parameters) for cause in hypothesis)
    kept = np.zeros((0, size))
    for _ in range(_TRIES):
        strata = np.column_stack([rng.permutation(count) for _ in range(size)]).reshape(count, size)
        values = values_of(hypothesis, (strata + rng.uniform(size=(count, size))) / count)
        kept = np.concatenate([kept, values[allowed_by(hypothesis, values)]])
        if len(kept) >= count:
            return kept[:count]
    raise ValueError(f"hardly any parameters of {', '.join(c.name for c in hypothesis)} are allowed")


def named(hypothesis: Hypothesis, values: Array) -> tuple[Named, ...]:
    """The effects of one row of parameters."""
    parts = zip(hypothesis, parts_of(hypothesis), strict=True)
    return tuple(cause.named(values[at]) for cause, at in parts)


def _intervals(parameter: Parameter) -> tuple[tuple[float, float], ...]:
    """Where it is searched: an angle within one turn."""
    (low, high), *_ = parameter.intervals
    return ((-pi, pi),) if parameter.unit == "rad" and high - low > 2 * pi else parameter.intervals


def _logarithmic(low: float, high: float) -> bool:
    return low * high > 0 and max(abs(low), abs(high)) > _WIDE * min(abs(low), abs(high))


def _value(parameter: Parameter, u: Array) -> Array:
    intervals = _intervals(parameter)
    count = len(intervals)
    which = np.clip((u * count).astype(int), 0, count - 1)
    share = u * count - which
    value = np.zeros_like(u)
    for k, (low, high) in enumerate(intervals):
        if parameter.whole:
            here = np.clip(np.floor(low + share * (high - low + 1)), low, high)
        elif _logarithmic(low, high):
            here = low * (high / low) ** share
        else:
            here = low + share * (high - low)
        value = np.where(which == k, here, value)
    return value


def _place(parameter: Parameter, value: Array) -> Array:
    intervals = _intervals(parameter)
    count = len(intervals)
    middles = np.array([0.5 * (low + high) for low, high in intervals])
    place = np.zeros_like(value)
    nearest = np.argmin(np.abs(value[:, None] - middles), axis=1)
    for k, (low, high) in enumerate(intervals):
        inside = np.clip(value, low, high)
        if parameter.whole:
            share = (inside - low + 0.5) / (high - low + 1)
        elif _logarithmic(low, high):
            share = np.log(np.where(inside * low > 0, inside, low) / low) / log(high / low)
        else:
            share = (inside - low) / (high - low)
        within = (value >= low) & (value <= high)
        place = np.where(within | ((nearest == k) & (place == 0)), (k + share) / count, place)
    return place
