"""What a diagnosis found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.belief import Unexplained, verdict_of
from sim_twin.diagnosis.cause import Cause, Hypothesis
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.posterior import Estimate
from sim_twin.diagnosis.subject import Named

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Judged:
    """An effect (on its most probable channel): its share of belief as the largest cause.

    `best` is it with parameters that may go together. `after` is the gap that is left with it alone in the
    twin, None where that was not simulated.
    """

    cause: Cause
    probability: float
    parameters: Mapping[str, Estimate]
    best: Named
    after: float | None
    shrink: float | None
    indistinguishable_from: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Gap:
    """Gap figures; cells are in floors, the units are what their root mean squares are divided by.

    `after` is None where something was selected and there was no time to simulate it. `recording` is how far
    the recording's own blocks lie from their mean.
    """

    before: float
    after: float | None
    shrink: float | None
    shrink_ci95: tuple[float, float] | None
    cells_before: Array
    cells_after: Array
    unit_before: float
    unit_after: float
    recording: float


@dataclass(frozen=True, slots=True)
class Findings:
    """Everything a report tells.

    `measured`, `nominal` and `repaired` twin are mean fingerprints (numbers,), `floor` what a healthy rig's
    block differs by from the twin in each cell (cells,). `held_out` is False where there was one block only,
    so that the gap was judged on what was fitted. `left` is what the best explanation does not explain.
    `runner_up` is the next best effect with the twin's mean fingerprint then; None where none was simulated.
    """

    layout: Layout
    none: float
    effect: float
    unknown: float
    judged: tuple[Judged, ...]
    selected: Hypothesis
    effects: tuple[Named, ...]
    gap: Gap
    by_location: Mapping[str, float]
    separability: Mapping[tuple[str, str], float]
    measured: Array
    nominal: Array
    repaired: Array | None
    floor: Array
    held_out: bool
    simulations: int
    left: Unexplained
    runner_up: tuple[Hypothesis, Array] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of what was selected."""
        return tuple(dict.fromkeys(cause.name for cause in self.selected))

    @property
    def verdict(self) -> str:
        """The most probable of "none", "effect" and "unknown"."""
        return verdict_of(self.none, self.effect, self.unknown)
