"""What a diagnosis found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.belief import Unexplained, verdict_of
from sim_twin.diagnosis.cause import Cause, Hypothesis, effects_of
from sim_twin.diagnosis.discrepancy import Discrepancy
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.posterior import Estimate
from sim_twin.diagnosis.subject import Named

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Judged:
    """An effect (on its most probable channel): its share of belief as the largest cause.

    `present` is the probability that it is there at all, alone or with others. `best` is it with parameters
    that may go together. `after` is the gap that is left with it alone in the twin, None where that was not
    simulated.
    """

    cause: Cause
    probability: float
    parameters: Mapping[str, Estimate]
    best: Named
    after: float | None
    shrink: float | None
    indistinguishable_from: tuple[str, ...] = ()
    present: float = 0.0


@dataclass(frozen=True, slots=True)
class Entered:
    """A value, the parameter of its `cause`: the probability that it was entered wrongly, and what fits."""

    cause: Cause
    probability: float
    estimate: Estimate


@dataclass(frozen=True, slots=True)
class Contrast:
    """A cell, by its number, in which two explanations differ: means of its numbers.

    `chosen` is predicted by what was selected (else by the nominal twin), `rival` by the runner-up; `apart`
    is how far these two are from each other in floors.
    """

    cell: int
    measured: float
    chosen: float
    rival: float
    apart: float


@dataclass(frozen=True, slots=True)
class Alone:
    """What one run says by itself: shares of belief of what is in question, most believed first.

    `estimates` are those of the parameters of `best`, cause by cause, by this run: of what was selected, else
    of what all runs together make the most probable effects.
    """

    run: int
    shares: tuple[tuple[Hypothesis, float], ...]
    best: Hypothesis
    estimates: tuple[tuple[Estimate, ...], ...]


@dataclass(frozen=True, slots=True)
class Gap:
    """Gap figures; cells are in floors, the units are what their root mean squares are divided by.

    `after` is None where something was selected and there was no time to simulate it. `recording` is how far
    the recording's own blocks lie from their mean. `course_before` and `course_after` (runs, blocks) are the
    gaps of a run's blocks in their order; none where there is nothing to tell.
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
    course_before: Sequence[Sequence[float]] = ()
    course_after: Sequence[Sequence[float]] = ()


@dataclass(frozen=True, slots=True)
class Findings:
    """Everything a report tells.

    `measured`, `nominal` and `repaired` twin are mean fingerprints (numbers,), `floor` what a healthy rig's
    block differs by from the twin in each cell (cells,). `held_out` is False where there was one block only,
    so that the gap was judged on what was fitted. `left` is what the best explanation does not explain.
    `runner_up` is the next best explanation with the twin's mean fingerprint then; None where none was
    simulated. `contrasts` are the figures in which it predicts otherwise, `alone` is what each of several
    runs says. `alone_off` is the one channel that does not fit where all others do. Of the rigs of the
    search, and of those that its answer is judged by, there was time for the shares `searched` and `judging`.
    `entered` are values that may have been entered wrongly, most probable first; none where nobody doubted.
    `not_fitting` are figures that the best explanation does not explain, with how many times as far off they
    are as one in a hundred of rigs as it says. `put_in` is all that the repaired twin has: `effects`, and
    values that were entered wrongly beside them.
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
    contrasts: tuple[Contrast, ...] = ()
    alone: tuple[Alone, ...] = ()
    searched: float = 1.0
    judging: float = 1.0
    alone_off: str = ""
    entered: tuple[Entered, ...] = ()
    not_fitting: tuple[tuple[Discrepancy, float], ...] = ()
    put_in: tuple[Named, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects that were selected."""
        return tuple(dict.fromkeys(cause.name for cause in effects_of(self.selected)))

    @property
    def verdict(self) -> str:
        """The most probable of "none", "effect" and "unknown"."""
        return verdict_of(self.none, self.effect, self.unknown)
