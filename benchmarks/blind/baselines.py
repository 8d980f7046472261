"""What plays beside the diagnosis: chance, the commonest answer, the best residual, and who knows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.blind.cases import NONE, UNKNOWN, Answer, Case, Estimate, Gaps, Ranked
from benchmarks.blind.catalogue import CATALOGUE

REPEATS = 100
"""How often chance plays, so that its own luck averages out."""
_LEAST_SHRINK = 0.1


def random_answers(cases: Sequence[Case], seed: int = 0) -> list[Case]:
    """Every answer as likely, in any order, over and over."""
    rng = np.random.default_rng(seed)
    return [_answered(case, _by_chance(case, rng)) for case in cases for _ in range(REPEATS)]


def majority_answers(cases: Sequence[Case]) -> list[Case]:
    """The shares with which the truths of the rig occur, always."""
    return [_answered(case, _weighted(case, _shares(case, cases))) for case in cases]


def best_residual_answers(cases: Sequence[Case]) -> list[Case]:
    """The effect that closes most of the held-out gap, for certain; "none" below a tenth, never "unknown"."""
    return [_answered(case, _best_residual(case)) for case in cases]


def oracle_answers(cases: Sequence[Case]) -> list[Case]:
    """The truth, for certain, with its parameters."""
    return [_answered(case, _certain(case), _closed(case.gaps)) for case in cases]


BASELINES: Mapping[str, Callable[[Sequence[Case]], list[Case]]] = {
    "random": random_answers,
    "majority": majority_answers,
    "best residual": best_residual_answers,
    "oracle": oracle_answers,
}


def _answered(case: Case, answer: Answer | None, gaps: Gaps | None = None) -> Case:
    unmeasured = None if case.gaps is None else replace(case.gaps, after=None)
    unknown = {"wall_s": None, "cpu_s": None, "memory_mb": None, "above": None, "outranks": None}
    return replace(case, answer=answer, gaps=gaps or unmeasured, **unknown)  # type: ignore[arg-type]


def _closed(gaps: Gaps | None) -> Gaps | None:
    return None if gaps is None else replace(gaps, after=gaps.oracle)


def _labels(case: Case) -> list[str]:
    return [*CATALOGUE[case.campaign.rig], NONE, UNKNOWN]


def _by_chance(case: Case, rng: np.random.Generator) -> Answer:
    labels = _labels(case)
    # So nearly equal that only the order is left to chance.
    weights = 1 + 1e-6 * rng.permutation(len(labels))
    return _weighted(case, dict(zip(labels, weights / weights.sum(), strict=True)))


def _shares(case: Case, cases: Sequence[Case]) -> dict[str, float]:
    labels = _labels(case)
    truths = Counter(
        label
        for other in cases
        if other.campaign.rig == case.campaign.rig
        for label in sorted(other.truth.intersection(labels))
    )
    return {label: truths[label] / max(1, truths.total()) for label in labels}


def _best_residual(case: Case) -> Answer | None:
    if case.answer is None:
        return None
    catalogue = CATALOGUE[case.campaign.rig]  # what people wire wrongly is judged by no baseline
    shrinks = {each.name: each.shrink or 0.0 for each in case.answer.effects if each.name in catalogue}
    best = max(shrinks, key=lambda name: shrinks[name])
    chosen = best if shrinks[best] >= _LEAST_SHRINK else NONE
    answer = _weighted(case, {chosen: 1.0})
    ranked = sorted(answer.effects, key=lambda effect: (-effect.probability, -shrinks.get(effect.name, 0.0)))
    return replace(answer, effects=tuple(ranked))


def _certain(case: Case) -> Answer:
    answer = _weighted(case, {min(case.truth): 1.0})
    known = tuple(_with_truth(effect, case) for effect in answer.effects)
    place = next(iter(case.campaign.places), "")
    return replace(answer, effects=known, selected=case.hidden, place=place)


def _with_truth(effect: Ranked, case: Case) -> Ranked:
    for entry in case.campaign.effects:
        values = entry["parameters"]
        if entry["name"] == effect.name and isinstance(values, dict):
            return replace(effect, parameters={name: _exactly(value) for name, value in values.items()})
    return effect


def _exactly(value: float | str) -> Estimate:
    return Estimate(value, None if isinstance(value, str) else (value, value))


def _weighted(case: Case, probabilities: Mapping[str, float]) -> Answer:
    catalogue = CATALOGUE[case.campaign.rig]
    effects = [Ranked(name, catalogue[name].location, probabilities.get(name, 0.0)) for name in catalogue]
    effects.sort(key=lambda effect: -effect.probability)
    first = max(_labels(case), key=lambda label: probabilities.get(label, 0.0))
    selected = (first,) if first in catalogue else ()
    return Answer(probabilities.get(NONE, 0.0), probabilities.get(UNKNOWN, 0.0), tuple(effects), selected)
