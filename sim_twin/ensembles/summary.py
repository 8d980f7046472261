"""What an ensemble's figures come to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_twin.ensembles.variant import Outcome
from sim_twin.rigs.side_by_side import RunFigures
from sim_twin.status import Status


@dataclass(frozen=True, slots=True)
class Spread:
    """One figure over the `runs` that have it, in its unit; `deviation` None for a single run."""

    runs: int
    mean: float
    deviation: float | None
    p5: float
    median: float
    p95: float


def spread_of(outcomes: Sequence[Outcome[RunFigures]]) -> dict[str, Spread]:
    """The spread of each figure over the runs that completed and have it."""
    columns: dict[str, list[float]] = {}
    for outcome in outcomes:
        if outcome.value is not None:
            for name, value in outcome.value.values.items():
                columns.setdefault(name, []).extend([] if value is None else [float(value)])
    return {name: _spread(np.array(column)) for name, column in columns.items() if column}


def failures(outcomes: Sequence[Outcome[object]]) -> Counter[Status]:
    """How many runs failed, and how."""
    return Counter(each.status for each in outcomes if each.status is not Status.COMPLETED)


def _spread(column: np.ndarray) -> Spread:
    p5, median, p95 = (float(value) for value in np.percentile(column, (5, 50, 95)))
    deviation = float(np.std(column, ddof=1)) if len(column) > 1 else None
    return Spread(len(column), float(np.mean(column)), deviation, p5, median, p95)
