"""Which effects these sensors and settings cannot tell apart, and how well a further run would.

Twin against twin; of a further run by Hainy et al. 2022, doi:10.1007/s11222-022-10078-2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sim_twin.diagnosis.attribution import TEMPER, Attribution
from sim_twin.diagnosis.cause import is_effect, values_of
from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.search import Ranked
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.subject import Draw, Execute, Named, Subject

Array = NDArray[np.float64]
_COMPARED = 6
_TOLD_APART = 0.75
"""Probability of a right choice between two effects, below which they are said to look alike."""
_EACH = 10
_SHRINK = 0.3
_IN_QUESTION = 0.01


def separability(
    attribution: Attribution, ranked: Sequence[Ranked], rng: np.random.Generator
) -> dict[tuple[str, str], float]:
    """Probability that a rig with the first effect, as it may be here, is not taken for one with the second.

    From the distance of the first one's response to the nearest one of the second (Neyman and Pearson).
    """
    alone: dict[str, Ranked] = {}
    for each in ranked:
        if is_effect(each.hypothesis) and each.hypothesis in attribution.emulators:
            alone.setdefault(each.hypothesis[0].name, each)
    compared = list(alone.items())[:_COMPARED]
    found = {}
    for one, first in compared:
        place = attribution.response(first.hypothesis, first.best()[None])[0][0]
        for other, second in compared:
            if one != other:
                posterior = attribution.posterior(second.hypothesis, place, rng)
                values = values_of(second.hypothesis, posterior.places)
                nearest = np.min(attribution.misfit(second.hypothesis, values, place)) * len(place)
                found[one, other] = float(ndtr(np.sqrt(nearest / TEMPER) / 2))
    return found


def inseparable(judged: Sequence[Judged], found: Mapping[tuple[str, str], float]) -> list[Judged]:
    """Write to each effect which others look like it."""
    return [
        replace(
            each,
            indistinguishable_from=tuple(
                other
                for (one, other), share in found.items()
                if one == each.cause.name and share < _TOLD_APART
            ),
        )
        for each in judged
    ]


def rivals_of(findings: Findings) -> tuple[Judged, Judged] | None:
    """The most probable effect, and what is most easily taken for it: the next one, if it may be at all.

    Else the one from which these sensors and settings tell it apart least. None where nothing is in question.
    """
    if findings.verdict == "none" or len(findings.judged) < 2:
        return None
    first, *others = sorted(findings.judged, key=lambda each: -each.probability)
    if others[0].probability >= _IN_QUESTION:
        return first, others[0]
    # how surely each is told from the first, by the less sure of both ways
    alike: dict[str, float] = {}
    for pair, share in findings.separability.items():
        for one, other in (pair, pair[::-1]):
            if one == first.cause.name:
                alike[other] = min(share, alike.get(other, 1.0))
    return first, min(others, key=lambda each: alike.get(each.cause.name, 1.0))


def told_apart(
    subject: Subject,
    rivals: tuple[Sequence[Named], Sequence[Named]],
    execute: Execute,
    rng: np.random.Generator,
) -> float | None:
    """Expected share of right choices between two rivals after the subject's runs.

    Some rigs with each are simulated; each is sorted by the others, to the nearer mean in their scatter.
    None where too few could be simulated.
    """
    draws = [Draw(tuple(rival), int(rng.integers(2**62))) for rival in rivals for _ in range(_EACH)]
    moments = Moments(subject.layout)
    groups: list[list[Array]] = [[], []]
    for number, shown in enumerate(execute(draws)):
        if shown and shown[0] is not None:
            groups[number // _EACH].append(moments(shown[0][0]))
    if min(len(group) for group in groups) < 4:
        return None
    first, second = (np.array(group) for group in groups)
    right = [_sorted_right(first, second, k) for k in range(len(first))]
    right += [_sorted_right(second, first, k) for k in range(len(second))]
    return (sum(right) + 1) / (len(right) + 2)


def _sorted_right(own: Array, other: Array, k: int) -> bool:
    rest = np.delete(own, k, axis=0)
    within = np.concatenate([rest - rest.mean(axis=0), other - other.mean(axis=0)])
    scatter = np.sqrt(np.mean(within**2, axis=0))
    scatter = (1 - _SHRINK) * scatter + _SHRINK * np.median(scatter) + 1e-12
    x, toward_own, toward_other = own[k] / scatter, rest.mean(axis=0) / scatter, other.mean(axis=0) / scatter
    return bool(np.sum((x - toward_own) ** 2) < np.sum((x - toward_other) ** 2))
