"""How well a further run would tell two effects apart (Hainy et al. 2022, doi:10.1007/s11222-022-10078-2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.draw import Draw, Named
from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.subject import Execute, Subject

Array = NDArray[np.float64]
_EACH = 10
_SHRINK = 0.3
_IN_QUESTION = 0.01


def rivals_of(findings: Findings) -> tuple[Judged, Judged] | None:
    """The most probable effect, and what is most easily taken for it: the next one, if it may be at all.

    Else the one from which these sensors and settings tell it apart least. None where nothing is in question.
    """
    if findings.verdict == "none" or len(findings.judged) < 2:
        return None
    first, *others = sorted(findings.judged, key=lambda each: -each.probability)
    if others[0].probability >= _IN_QUESTION:
        return first, others[0]
    alike = _alike(findings.separability, first.cause.name)
    return first, min(others, key=lambda each: alike.get(each.cause.name, 1.0))


def _alike(separability: Mapping[tuple[str, str], float], name: str) -> dict[str, float]:
    """How surely each other effect is told from one, by the less sure of both ways."""
    found: dict[str, float] = {}
    for (one, other), share in separability.items():
        if name in (one, other):
            rival = other if one == name else one
            found[rival] = min(share, found.get(rival, 1.0))
    return found


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
