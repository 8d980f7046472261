"""Observes the figures of every run, and sums them up."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from daq.errors import SimulationFailed
from sim_twin.ensembles.simulate import Outcome, Variant, status_of
from sim_twin.rigs.rig_model import RunFigures
from sim_twin.status import Status


@dataclass(frozen=True, slots=True)
class Figures:
    """The rig's own figures of the motion from rest, over `duration` s after the first `settle` s.

    Rigs that have no way to run side by side start at phase 0; another phase is a ValueError.
    """

    settle: float
    duration: float
    together: ClassVar[int] = 16

    def observe(self, variants: Sequence[Variant]) -> list[Outcome[RunFigures]]:
        """Figures of some runs of one rig."""
        model = variants[0].twin.model
        figures = None if model.side_by_side is None else model.side_by_side.figures
        if figures is not None:
            twins, phases = [each.twin for each in variants], [each.phase for each in variants]
            together = figures(twins, phases, self.settle, self.duration)
            return [_outcome(each) for each in together]
        found: list[Outcome[RunFigures]] = []
        for variant in variants:
            if variant.phase != 0:
                raise ValueError(f"figures of the {model.name} start at phase 0, not {variant.phase:g} rad")
            try:
                values = model.solver_values(variant.twin, self.settle, self.duration)
            except SimulationFailed as error:
                found.append(Outcome(status_of(error)))
                continue
            finite = all(value is None or np.isfinite(value) for value in values.values())
            found.append(_outcome(RunFigures(Status.COMPLETED if finite else Status.DIVERGED, values)))
        return found


def _outcome(figures: RunFigures) -> Outcome[RunFigures]:
    return Outcome(figures.status, figures if figures.status is Status.COMPLETED else None)


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
    spreads = {}
    for name, column in columns.items():
        if column:
            p5, median, p95 = (float(value) for value in np.percentile(column, (5, 50, 95)))
            deviation = float(np.std(column, ddof=1)) if len(column) > 1 else None
            spreads[name] = Spread(len(column), float(np.mean(column)), deviation, p5, median, p95)
    return spreads


def failures(outcomes: Sequence[Outcome[object]]) -> Counter[Status]:
    """How many runs failed, and how."""
    return Counter(each.status for each in outcomes if each.status is not Status.COMPLETED)
