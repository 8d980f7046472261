"""What "unknown" is worth on classes of outsiders that no threshold was set with.

Each class in turn is left out: a threshold, and a score, are set by the other classes and by one half of the
campaigns that hold nothing unknown, and judged on the class left out and on the other half.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression

from benchmarks.blind.cases import Case
from benchmarks.blind.metrics import share_below, unknown_score

Array = NDArray[np.float64]
_LEAST = 1e-3


@dataclass(frozen=True, slots=True)
class Fold:
    """Cases to set by and to judge; of both, those with something unknown in and those without."""

    set_by: tuple[list[Case], list[Case]]
    judged: tuple[list[Case], list[Case]]


def folds(cases: Sequence[Case]) -> Iterator[Fold]:
    """One for each class of outsiders and each half of the others."""
    outside, inside = ([case for case in cases if case.outside is which] for which in (True, False))
    halves = inside[::2], inside[1::2]
    for name in sorted({class_of(case) for case in outside}):
        own, others = (
            [case for case in outside if (class_of(case) == name) is which] for which in (True, False)
        )
        for here, there in (halves, halves[::-1]):
            yield Fold((others, here), (own, there))


def class_of(case: Case) -> str:
    """The class of what is hidden outside of the catalogue."""
    return str(case.campaign.effects[0]["name"])


def with_classes_held_out(cases: Sequence[Case]) -> list[Case]:
    """The cases, each with what thresholds and scores set without its class, or its half, make of it.

    `above`: share of the thresholds that its p(unknown) is above; `outranks`, of outsiders: share of the
    others that are below it by a logistic score of p(unknown) and of the gap that is left.
    """
    above: dict[int, list[float]] = defaultdict(list)
    outranks: dict[int, list[float]] = defaultdict(list)
    for fold in folds(cases):
        if not all(fold.set_by) or not all(fold.judged):
            continue
        at = threshold(*(_scores(part) for part in fold.set_by))
        for part in fold.judged:
            for case, p in zip(part, _scores(part), strict=True):
                above[id(case)].append(float(p > at))
        outside, inside = (_fitted(fold.set_by).decision_function(_figures(part)) for part in fold.judged)
        for case, score in zip(fold.judged[0], outside, strict=True):
            outranks[id(case)].append(share_below(score, inside))
    return [replace(case, above=_mean(above[id(case)]), outranks=_mean(outranks[id(case)])) for case in cases]


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def threshold(outside: Array, inside: Array) -> float:
    """Above which most outsiders and fewest others lie: where the sum of both shares is largest."""
    every = np.unique(np.concatenate([outside, inside]))
    between = (every[1:] + every[:-1]) / 2
    shares = [np.mean(outside > at) + np.mean(inside <= at) for at in between]
    return float(between[int(np.argmax(shares))]) if len(between) else math.inf


def _scores(cases: Sequence[Case]) -> Array:
    return np.array([unknown_score(case) for case in cases])


def _fitted(set_by: tuple[list[Case], list[Case]]) -> LogisticRegression:
    figures = np.concatenate([_figures(part) for part in set_by])
    labels = np.repeat([1, 0], [len(part) for part in set_by])
    return LogisticRegression(class_weight="balanced").fit(figures, labels)


def _figures(cases: Sequence[Case]) -> Array:
    """Logit of p(unknown) and logarithm of the gap left, shape (n, 2)."""
    p = np.clip(_scores(cases), _LEAST, 1 - _LEAST)
    left = [1.0 if case.answer is None or case.answer.left is None else case.answer.left for case in cases]
    return np.column_stack([np.log(p / (1 - p)), np.log(np.maximum(left, _LEAST))])
