"""Which effects these sensors and settings cannot tell apart: twin against twin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from sim_twin.diagnosis.attribution import TEMPER, Attribution
from sim_twin.diagnosis.cause import values_of
from sim_twin.diagnosis.findings import Judged
from sim_twin.diagnosis.search import Ranked

_COMPARED = 6
_TOLD_APART = 0.75
"""Probability of a right choice between two effects, below which they are said to look alike."""


def separability(
    attribution: Attribution, ranked: Sequence[Ranked], rng: np.random.Generator
) -> dict[tuple[str, str], float]:
    """Probability that a rig with the first effect, as it may be here, is not taken for one with the second.

    From the distance of the first one's response to the nearest one of the second (Neyman and Pearson).
    """
    alone: dict[str, Ranked] = {}
    for each in ranked:
        if len(each.hypothesis) == 1:
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
                found[one, other] = float(norm.cdf(np.sqrt(nearest / TEMPER) / 2))
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
