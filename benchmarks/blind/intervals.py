"""95 % intervals: Wilson's for shares, the bootstrap's for everything else."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias, TypeVar

import numpy as np

Interval: TypeAlias = tuple[float, float]
T = TypeVar("T")

_NORMAL_95 = 1.959964
_RESAMPLES = 1000


def wilson(hits: float, trials: int) -> Interval:
    """Score interval of `hits` (parts of hits too) out of `trials` (10.1080/01621459.1927.10502953)."""
    share, z2 = hits / trials, _NORMAL_95**2
    middle = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    half = _NORMAL_95 / (1 + z2 / trials) * math.sqrt(share * (1 - share) / trials + z2 / (4 * trials**2))
    return max(0.0, middle - half), min(1.0, middle + half)


def share_of(hits: Sequence[bool]) -> str:
    """How many of how many, with their share and its interval."""
    if not hits:
        return "nothing measured"
    low, high = wilson(sum(hits), len(hits))
    return f"{sum(hits)} of {len(hits)} ({sum(hits) / len(hits):.3f}, 95 %: {low:.3f} to {high:.3f})"


def bootstrap(statistic: Callable[[Sequence[T]], float], cases: Sequence[T], seed: int = 0) -> Interval:
    """Percentile interval of a statistic over cases drawn with replacement."""
    rng = np.random.default_rng(seed)
    draws = rng.integers(len(cases), size=(_RESAMPLES, len(cases)))
    values = [statistic([cases[index] for index in draw]) for draw in draws]
    low, high = np.nanpercentile(values, (2.5, 97.5))
    return float(low), float(high)
