"""From evidences to probabilities: of nothing missing, of each effect, of something that none explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.cause import Cause, Hypothesis, parts_of
from sim_twin.diagnosis.library import Library
from sim_twin.diagnosis.search import Ranked

Array = NDArray[np.float64]
UNKNOWN = 0.15
"""What is believed beforehand of something outside the catalogue."""
_KNOWN_MISFIT = (np.log(0.38), 0.42)
_UNKNOWN_MISFIT = (np.log(2.5), 1.1)
"""Means and deviations of the misfit's logarithm, with the true effects in the catalogue and without: set by
eye on sixteen development campaigns of another engine (`python -m benchmarks.blind make DIR --seed 901`)."""
_NEAREST = 12
_TYPICAL = float(np.exp(_KNOWN_MISFIT[0]))


@dataclass(frozen=True, slots=True)
class Belief:
    """Probabilities that add up to 1: `none`, `unknown`, and of each effect that it is the largest cause."""

    none: float
    unknown: float
    of_effects: Mapping[str, float]
    misfit: float

    @property
    def effect(self) -> float:
        """That effects of the catalogue explain it."""
        return sum(self.of_effects.values())

    @property
    def verdict(self) -> str:
        """The most probable of the three."""
        shares = {"none": self.none, "effect": self.effect, "unknown": self.unknown}
        return max(shares, key=lambda each: shares[each])


def belief_of(
    attribution: Attribution, library: Library, ranked: Sequence[Ranked], measured: NDArray[np.float32]
) -> Belief:
    """Weigh the ranked hypotheses against what the best of them leaves unexplained."""
    misfit = max(ranked[0].misfit, _outside(attribution, library, ranked[0], measured))
    unknown = _unknown(misfit)
    of_effects: dict[str, float] = {}
    none = 0.0
    for each in ranked:
        share = (1 - unknown) * each.probability
        if not each.hypothesis:
            none += share
            continue
        name = largest(attribution, each.hypothesis, each.best())
        of_effects[name] = of_effects.get(name, 0.0) + share
    return Belief(none, unknown, of_effects, misfit)


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


def _outside(
    attribution: Attribution, library: Library, best: Ranked, measured: NDArray[np.float32]
) -> float:
    """Square of what lies in no direction, in that of like rigs, the odd ones among them."""
    moments, space = attribution.moments, attribution.space
    if space.basis.shape[1] >= space.basis.shape[0]:
        return 0.0  # the directions hold everything
    here = float(np.mean(space.outside(moments(measured))))
    hypothesis = best.hypothesis
    fingerprints = library.fingerprints(hypothesis)
    near = np.arange(len(fingerprints))
    if hypothesis:
        values, aim = library.values(hypothesis), best.best()
        far = np.sum(((values - aim) / (values.std(axis=0) + 1e-12)) ** 2, axis=1)
        near = np.argsort(far)[:_NEAREST]
    there = np.array([np.mean(space.outside(moments(fingerprints[int(k)]))) for k in near])
    return float(_TYPICAL * (here / np.percentile(there, 90)) ** 2)


def _unknown(misfit: float) -> float:
    known = (1 - UNKNOWN) * norm.pdf(np.log(misfit), *_KNOWN_MISFIT)
    beyond = UNKNOWN * norm.pdf(np.log(misfit), *_UNKNOWN_MISFIT)
    # a misfit that is better than any known one is not unknown
    return float(beyond / (known + beyond)) if misfit > np.exp(_KNOWN_MISFIT[0]) else min(0.02, UNKNOWN)
