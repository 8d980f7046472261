"""From evidences to probabilities: of nothing missing, of each effect, of something that none explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.cause import Cause, Hypothesis, parts_of
from sim_twin.diagnosis.search import Ranked
from sim_twin.diagnosis.unexplained import Unexplained

Array = NDArray[np.float64]
_REFUTED = 0.1
"""Of what effects were believed, what is left after a test on other data that they did not pass."""


def verdict_of(none: float, effect: float, unknown: float) -> str:
    """The most probable of "none", "effect" and "unknown"."""
    shares = {"none": none, "effect": effect, "unknown": unknown}
    return max(shares, key=lambda each: shares[each])


@dataclass(frozen=True, slots=True)
class Belief:
    """Probabilities that add up to 1: `none`, `unknown`, and of each effect that it is the largest cause."""

    none: float
    unknown: float
    of_effects: Mapping[str, float]

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
        kept = {name: _REFUTED * share for name, share in self.of_effects.items()}
        return Belief(self.none, self.unknown + self.effect - sum(kept.values()), kept)


def belief_of(attribution: Attribution, ranked: Sequence[Ranked], left: Unexplained) -> Belief:
    """Weigh the ranked hypotheses against what the best of them leaves unexplained."""
    unknown = left.unknown
    of_effects: dict[str, float] = {}
    none = 0.0
    for each in ranked:
        share = (1 - unknown) * each.probability
        if not each.hypothesis:
            none += share
            continue
        name = largest(attribution, each.hypothesis, each.best())
        of_effects[name] = of_effects.get(name, 0.0) + share
    return Belief(none, unknown, of_effects)


def largest(attribution: Attribution, hypothesis: Hypothesis, values: Array) -> str:
    """Name of the cause with the largest response."""
    shares = contributions(attribution, hypothesis, values)
    return max(shares, key=lambda cause: shares[cause]).name


def contributions(attribution: Attribution, hypothesis: Hypothesis, values: Array) -> dict[Cause, float]:
    """Share of each cause in a hypothesis's response, by squares."""
    sizes = {}
    for cause, at in zip(hypothesis, parts_of(hypothesis), strict=True):
        mean, _ = attribution.response((cause,), values[None, at])
        sizes[cause] = float(np.sum(mean**2))
    total = sum(sizes.values()) or 1.0
    return {cause: size / total for cause, size in sizes.items()}
