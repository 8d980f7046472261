"""Simulates where it tells most: every cause first, then what explains the measurement, alone and in pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.cause import Cause, Hypothesis, drawn, values_of
from sim_twin.diagnosis.learning import learned
from sim_twin.diagnosis.library import Library, Order, order_of
from sim_twin.diagnosis.posterior import Posterior
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.subject import Execute, Subject

Array = NDArray[np.float64]
NONE, SINGLE, PAIR = 0.35, 0.45, 0.20
"""What is believed beforehand of nothing, one, or two effects being missing."""
TEMPER = 3.0
"""A synthetic likelihood is too sure of itself by about this factor in its logarithm; measured on blind campaigns."""
_FIRST, _SECOND = 0.5, 0.28
_HEALTHY_SHARE = 0.2
_FEWEST_HEALTHY = 60
_FEWEST_EACH = 10
_PAIRS_LOOKED_AT = 24
_PAIRS_SIMULATED = 6
_PARTNERS = 10
_LEAST_SHARE = 0.004
_FROM_PRIOR = 0.15


@dataclass(frozen=True, slots=True)
class Ranked:
    """One hypothesis after the search: its share of belief among all, its posterior, what it leaves."""

    hypothesis: Hypothesis
    probability: float
    posterior: Posterior
    misfit: float

    def values(self) -> Array:
        """Parameters of the posterior's places, shape (n, parameters)."""
        return values_of(self.hypothesis, self.posterior.places)

    def best(self) -> Array:
        """The most probable parameters: of each the weighted median, shape (parameters,)."""
        values = self.values()
        return np.array([quantile(column, self.posterior.weights, 0.5) for column in values.T])


def quantile(values: Array, weights: Array, share: float) -> float:
    """The value below which `share` of the weight lies."""
    order = np.argsort(values)
    at = np.searchsorted(np.cumsum(weights[order]), share * weights.sum())
    return float(values[order[min(at, len(values) - 1)]])


@dataclass(slots=True)
class Search:
    """A library that grows towards what explains `measured` (blocks, numbers)."""

    subject: Subject
    measured: NDArray[np.float32]
    execute: Execute
    rng: np.random.Generator
    library: Library
    motions: int

    def run(self) -> tuple[Attribution, list[Ranked]]:
        """Spend the motions; the most probable hypothesis comes first."""
        first = self.first_order()
        self._do(first)
        rest = max(0, self.motions - len(first))
        for share in (_SECOND / (1 - _FIRST), 1.0):
            attribution = self.learn()
            ranked = self.rank(attribution, [*self.singles(), *self.promising_pairs(attribution)])
            order = self.next_order(ranked, int(share * rest))
            rest -= len(order)
            self._do(order)
        attribution = self.learn()
        pairs = [h for h in attribution.emulators if len(h) == 2]
        return attribution, self.rank(attribution, [*self.singles(), *pairs], effort=2)

    def learn(self) -> Attribution:
        return learned(self.library, Moments(self.subject.layout), len(self.measured))

    def singles(self) -> list[Hypothesis]:
        return [(), *((cause,) for cause in self.subject.causes if self.library.count((cause,)) >= _FEWEST_EACH // 2)]

    def first_order(self) -> Order:
        """Healthy rigs, and every cause evenly over its parameters; those of sensors ride on healthy motions."""
        causes = self.subject.causes
        moving = [cause for cause in causes if not cause.sensing]
        motions = int(_FIRST * self.motions)
        healthy = max(_FEWEST_HEALTHY, int(_HEALTHY_SHARE * motions))
        each = max(_FEWEST_EACH, (motions - healthy) // max(1, len(moving) + (len(causes) - len(moving)) // 6))
        cases = {(cause,): drawn((cause,), each, self.rng) for cause in causes}
        return order_of({(): np.zeros((healthy, 0))}, self.rng, blocks=2) + order_of(cases, self.rng)

    def promising_pairs(self, attribution: Attribution) -> list[Hypothesis]:
        """Pairs whose responses, added up, explain the measurement best."""
        place = attribution.place(self.measured).mean(axis=0)
        causes = [h[0] for h in self.singles() if h]
        pairs = [pair for pair in combinations(causes, 2) if pair[0].name != pair[1].name or pair[0].channel]
        quick = [(attribution.posterior(pair, place, self.rng, 1).log_evidence, k) for k, pair in enumerate(pairs)]
        return [pairs[k] for _, k in sorted(quick, reverse=True)[:_PAIRS_LOOKED_AT]]

    def rank(self, attribution: Attribution, hypotheses: Sequence[Hypothesis], effort: int = 1) -> list[Ranked]:
        """All hypotheses by belief."""
        place = attribution.place(self.measured).mean(axis=0)
        found = [attribution.posterior(h, place, self.rng, effort) for h in hypotheses]
        logs = np.array([each.log_evidence for each in found]) / TEMPER
        logs += np.log([self._prior(h) for h in hypotheses])
        belief = np.exp(logs - logs.max())
        belief /= belief.sum()
        ranked = []
        for h, share, posterior in zip(hypotheses, belief, found, strict=True):
            best = values_of(h, posterior.places[[int(np.argmax(posterior.weights))]])
            misfit = float(attribution.misfit(h, best, place)[0])
            ranked.append(Ranked(h, float(share), posterior, misfit))
        return sorted(ranked, key=lambda each: -each.probability)

    def _prior(self, hypothesis: Hypothesis) -> float:
        """Effects are alike beforehand, however many channels they may sit on."""
        causes = self.subject.causes
        names = {cause.name for cause in causes}
        each = [1 / len(names) / sum(c.name == cause.name for c in causes) for cause in hypothesis]
        if not hypothesis:
            return NONE
        return SINGLE * each[0] if len(each) == 1 else 2 * PAIR * each[0] * each[1]

    def next_order(self, ranked: Sequence[Ranked], motions: int) -> Order:
        """More of what is believed, about where it is believed."""
        kept = [each for each in ranked if each.hypothesis and each.probability > _LEAST_SHARE]
        several = [each for each in kept if len(each.hypothesis) > 1][:_PAIRS_SIMULATED]
        chosen = [each for each in kept if len(each.hypothesis) == 1] + several
        if not chosen:
            chosen = [each for each in ranked if each.hypothesis][:3]
        weight = np.sqrt([each.probability for each in chosen])
        cost = np.array([1 / 6 if all(c.sensing for c in each.hypothesis) else 1.0 for each in chosen])
        counts = np.maximum(6, motions * weight / np.sum(weight * cost)).astype(int)
        counts = np.minimum(counts, np.where(cost < 1, 150, motions))
        cases = {
            each.hypothesis: self._around(each, int(count)) for each, count in zip(chosen, counts, strict=True)
        }
        return order_of(cases, self.rng)

    def _around(self, ranked: Ranked, count: int) -> Array:
        """Parameters from the posterior, flattened, and some from anywhere."""
        weights = ranked.posterior.weights ** (1 / TEMPER)
        places = ranked.posterior.places
        some = places[self.rng.choice(len(places), count, p=weights / weights.sum())]
        near = values_of(ranked.hypothesis, some)
        anywhere = self.rng.uniform(size=count) < _FROM_PRIOR
        near[anywhere] = drawn(ranked.hypothesis, count, self.rng)[anywhere]
        return near

    def _do(self, order: Order) -> None:
        self.library.add(order, self.execute(order.draws))
