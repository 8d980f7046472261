"""What the runs of an ensemble are drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.random import Generator, SeedSequence

from sim_twin.effects import Effect
from sim_twin.ensembles.simulate import Variant
from sim_twin.twin import AnyTwin

PartOfAnEffect: TypeAlias = tuple[str, Mapping[str, float | str]]
_TRIES = 100


@dataclass(frozen=True, slots=True)
class Between:
    """Operating points between two drives: each number that differs is drawn on its own, uniformly."""

    low: Any
    high: Any

    def drawn(self, rng: Generator) -> Any:
        numbers = {}
        for each in fields(self.low):
            low, high = getattr(self.low, each.name), getattr(self.high, each.name)
            if low != high:
                numbers[each.name] = float(rng.uniform(low, high))
        return replace(self.low, **numbers)


@dataclass(frozen=True, slots=True)
class Population:
    """Rigs like `twin`, each with the named `effects` in and at one of the operating points.

    Parameters that an effect leaves open are drawn from their ranges. `points` are drives that take turns, or
    a range of them; empty: the twin's own. `healthy` rigs differ by their tolerances and have noise;
    `any_phase` starts them at any phase of the drive, else at 0.
    """

    twin: AnyTwin
    effects: tuple[PartOfAnEffect, ...] = ()
    points: tuple[Any, ...] | Between = ()
    healthy: bool = True
    any_phase: bool = True

    def variant(self, seed: int, index: int) -> Variant:
        """Draw run `index` of `seed`, which depends on nothing else.

        Raises ValueError for an effect that the rig cannot have.
        """
        rng = np.random.default_rng(SeedSequence(seed, spawn_key=(index, 0)))
        model = self.twin.model
        drive = self.twin.drive
        if isinstance(self.points, Between):
            drive = self.points.drawn(rng)
        elif self.points:
            drive = self.points[index % len(self.points)]
        twin = replace(self.twin, drive=drive)
        for name, given in self.effects:
            if name not in model.effects:
                raise ValueError(f"no effect {name!r}; known: {', '.join(model.effects)}")
            twin = _with_effect(model.effects[name], twin, given, rng)
        noise = None
        if self.healthy:
            twin = model.draw_healthy(twin, rng, rng)
            noise = SeedSequence(seed, spawn_key=(index, 1))
        phase = float(rng.uniform(0, 2 * np.pi)) if self.any_phase else 0.0
        return Variant(twin, phase, noise)

    def variants(self, runs: int, seed: int) -> tuple[Variant, ...]:
        """Draw runs 0 ... `runs` - 1 of `seed`."""
        return tuple(self.variant(seed, index) for index in range(runs))


def _with_effect(effect: Effect, twin: AnyTwin, given: Mapping[str, float | str], rng: Generator) -> AnyTwin:
    """Parameters that are fine one by one may be refused together; such a draw is drawn again."""
    for _ in range(_TRIES - 1):
        try:
            return effect.apply(twin, {**_drawn(effect, rng), **given})
        except ValueError:
            continue
    return effect.apply(twin, {**_drawn(effect, rng), **given})


def _drawn(effect: Effect, rng: Generator) -> dict[str, float | str]:
    values: dict[str, float | str] = {}
    for parameter in effect.parameters:  # uniform over all its intervals
        low, high = np.array(parameter.intervals).T
        chosen = rng.choice(len(low), p=(high - low) / np.sum(high - low))
        values[parameter.name] = float(rng.uniform(low[chosen], high[chosen]))
    if effect.channels:
        values["channel"] = effect.channels[int(rng.integers(len(effect.channels)))]
    return values
