"""From evidences to probabilities: of nothing missing, of each effect, of something that none explains."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.cause import Cause, Hypothesis, effects_of, parts_of
from sim_twin.diagnosis.gap import GapMeasure
from sim_twin.diagnosis.search import Ranked

Array = NDArray[np.float64]
_MISFIT, _OUTSIDE, _GAP = (np.log(0.45), 0.6), (np.log(0.92), 0.15), (np.log(0.85), 0.3)
"""Means and deviations of the three figures' logarithms where the catalogue holds the truth."""
_LEAST = -0.5
"""So that one figure that is better than usual does not outweigh another that is bad."""
_DOUBTFUL, _SLOPE = 4.8, 1.2
"""Sum of what they are off by, in deviations, at which one believes as much as not; and how fast that turns.
All set by eye on development campaigns of another engine (`python -m benchmarks.blind make DIR`, seeds 901
and 23678)."""
_NEVER_LESS = 0.015
"""No fit of what is known rules out what is not."""
_REFUTED = 0.1
"""Of what effects were believed, what is left after a test on other data that they did not pass."""


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What is left of a measurement.

    `misfit`: mean square in the directions in which effects differ, in the scatter of like rigs. `outside`:
    what lies in no such direction, `gap`: what is left of the gap, both over what nine in ten like rigs have.
    """

    misfit: float
    outside: float
    gap: float

    @property
    def unknown(self) -> float:
        """Probability that something outside the catalogue is there."""
        figures = ((self.misfit, _MISFIT), (self.outside, _OUTSIDE), (self.gap, _GAP))
        off = sum(max((np.log(max(x, 1e-3)) - mean) / deviation, _LEAST) for x, (mean, deviation) in figures)
        return float(max(1 / (1 + np.exp(-_SLOPE * (off - _DOUBTFUL))), _NEVER_LESS))


def unexplained(
    attribution: Attribution, measure: GapMeasure, like: Array, measured: NDArray[np.float32], healthy: bool
) -> Unexplained:
    """What rigs with the best hypothesis in leave of `measured` (blocks, numbers).

    `like` are fingerprints (n, numbers) of such rigs, of which nothing was learned; `healthy` where the
    hypothesis is that nothing is missing.
    """
    places = attribution.place(like)
    mean, variance = places.mean(axis=0), places.var(axis=0, ddof=1)
    scatter = attribution.scatter + np.maximum(variance - 1, 0.0) + variance / len(like)
    misfit = np.mean((attribution.place(measured).mean(axis=0) - mean) ** 2 / scatter)
    twin = measure if healthy else measure.of_repaired(like)
    usual = np.percentile([twin.total(twin.cells(each[None])) for each in like], 90)
    gap = twin.total(twin.cells(measured)) / float(usual)
    moments, space = attribution.moments, attribution.space
    outside = 0.0
    if space.basis.shape[1] < space.basis.shape[0]:  # else the directions hold everything
        there = np.percentile(space.outside(moments(like)), 90)
        outside = float(np.mean(space.outside(moments(measured))) / there)
    return Unexplained(float(misfit), outside, gap)


def verdict_of(none: float, effect: float, unknown: float) -> str:
    """The most probable of "none", "effect" and "unknown"."""
    shares = {"none": none, "effect": effect, "unknown": unknown}
    return max(shares, key=lambda each: shares[each])


@dataclass(frozen=True, slots=True)
class Belief:
    """Probabilities that add up to 1: `none`, `unknown`, and of each effect that it is the largest cause.

    `unexplained` is the part of `unknown` that nothing explains; the rest is `of_values` that were entered
    wrongly, and no effect. `present`, of each effect that it is there at all, alone or with another: those of
    a pair both count it; `entered`, the same of each value.
    """

    none: float
    unexplained: float
    of_effects: Mapping[str, float]
    present: Mapping[str, float]
    entered: Mapping[str, float] = field(default_factory=dict)
    of_values: float = 0.0

    @property
    def unknown(self) -> float:
        """That no effect of the catalogue explains it."""
        return self.unexplained + self.of_values

    @property
    def effect(self) -> float:
        """That effects of the catalogue explain it."""
        return sum(self.of_effects.values())

    @property
    def verdict(self) -> str:
        """The most probable of the three."""
        return verdict_of(self.none, self.effect, self.unknown)

    def refuted(self) -> Belief:
        """The same after data that were not fitted spoke against the effects: most of it is unknown then."""
        kept, present = (
            {name: _REFUTED * share for name, share in shares.items()}
            for shares in (self.of_effects, self.present)
        )
        unexplained = self.unexplained + self.effect - sum(kept.values())
        return replace(self, unexplained=unexplained, of_effects=kept, present=present)

    def without(self, idle: Collection[str], largest: str) -> Belief:
        """The same after data that were not fitted showed that these causes mend nothing beside others.

        Of what is left the `largest` has what they had as the largest cause.
        """
        if not idle:
            return self
        present, entered, of_effects = (
            {name: _REFUTED * share if name in idle else share for name, share in shares.items()}
            for shares in (self.present, self.entered, self.of_effects)
        )
        of_effects[largest] = of_effects.get(largest, 0.0) + self.effect - sum(of_effects.values())
        present[largest] = max(present.get(largest, 0.0), of_effects[largest])
        return replace(self, present=present, entered=entered, of_effects=of_effects)


def belief_of(
    attribution: Attribution, ranked: Sequence[Ranked], left: Unexplained, done: float = 1.0
) -> Belief:
    """Weigh the ranked hypotheses against what the best of them leaves unexplained.

    Where only the share `done` of a search was, that counts by as much too.
    """
    explained = (1 - left.unknown) ** done / (left.unknown**done + (1 - left.unknown) ** done)
    of_effects, present, entered = (defaultdict[str, float](float) for _ in range(3))
    none, of_values = 0.0, 0.0
    for each in ranked:
        share = explained * each.probability
        effects = {cause.name for cause in effects_of(each.hypothesis)}
        for name in {cause.name for cause in each.hypothesis}:
            (present if name in effects else entered)[name] += share
        if effects:
            of_effects[largest(attribution, each.hypothesis, each.best())] += share
        elif each.hypothesis:
            of_values += share
        else:
            none += share
    return Belief(none, 1 - explained, of_effects, present, entered, of_values)


def of_a_part(ranked: Sequence[Ranked], done: float) -> list[Ranked]:
    """What is believed where only the share `done` of a search was: evidence counts by as much.

    Probabilities are evener and posteriors wider; all as it is where `done` is 1.
    """
    if done >= 1.0:
        return list(ranked)
    shares = np.array([each.probability for each in ranked]) ** done
    return [
        replace(each, probability=float(share), posterior=each.posterior.tempered(done))
        for each, share in zip(ranked, shares / shares.sum(), strict=True)
    ]


def largest(attribution: Attribution, hypothesis: Hypothesis, values: Array) -> str:
    """Name of the effect with the largest response."""
    shares = contributions(attribution, hypothesis, values)
    return max(effects_of(hypothesis), key=lambda cause: shares[cause]).name


def contributions(attribution: Attribution, hypothesis: Hypothesis, values: Array) -> dict[Cause, float]:
    """Share of each cause in a hypothesis's response, by squares."""
    if len(hypothesis) == 1:
        return {hypothesis[0]: 1.0}
    sizes = {}
    for cause, at in zip(hypothesis, parts_of(hypothesis), strict=True):
        mean, _ = attribution.response((cause,), values[None, at])
        sizes[cause] = float(np.sum(mean**2))
    total = sum(sizes.values()) or 1.0
    return {cause: size / total for cause, size in sizes.items()}
