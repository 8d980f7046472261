"""Where eight runs of a mechanism stand: arrays that their kernel changes in place, lanes last."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import mechanical
from sim_twin.lane_array import LaneArray, lanes_of
from sim_twin.mechanisms.run import Real
from sim_twin.vector import LANES

Lanes = NDArray[np.float64]
"""Of shape (..., 8)."""
Index = NDArray[np.int64]
NOW, BEFORE, TRIED, STEP, STEP_BEFORE_ONSET, WHOLE, ERROR, SQUARED = range(8)
"""Rows of `clock`: as in `run`, s; `TRIED` is the step that is tried, `WHOLE` the one in which an onset is
sought; `SQUARED` is its error."""
AT, LOW, HIGH, LOW_DEPTH, HIGH_DEPTH, FIRST = range(6)
"""Rows of `sought`: fractions of the step and depths in m of a search in it."""
GOING, SAMPLES, TRIES, RETAKEN, PHASE, SIDE, SEEKS = range(7)
"""Rows of `counts`. `GOING`: 1 where a lane has samples to give, else 0; minus its status where it failed.
`RETAKEN`: how often a step up to an onset was tried."""
SPARE = LANES - 1
"""Columns behind the samples that are asked for: they are written eight at a time."""


class LaneRun(NamedTuple):
    """Where eight runs stand: as in `run.Run`, with the lanes as last axis.

    `kept` is the dense output of the last step, `dense` that of the step in work. `accepted` and `changed`
    are 1 in the lanes that they hold of. `shown` takes eight samples of one lane, beside their numbers.
    """

    y: Lanes
    trial: Lanes
    slopes: Lanes
    dense: Lanes
    kept: Lanes
    latched: Lanes
    during: Lanes
    penetration: Lanes
    rate: Lanes
    new_penetration: Lanes
    new_rate: Lanes
    new_force: Lanes
    late_force: Lanes
    between: Lanes
    sought_penetration: Lanes
    sought_rate: Lanes
    tolerance: Lanes
    clock: Lanes
    sought: Lanes
    accepted: Lanes
    changed: Lanes
    shown: Lanes
    counts: Index
    floor: Real
    """(8,) m/s; see `StepLimits`."""


class InWork(NamedTuple):
    """The arrays of a `LaneRun` that kernels compute with, as arrays of vectors."""

    y: LaneArray
    trial: LaneArray
    slopes: LaneArray
    dense: LaneArray
    kept: LaneArray
    latched: LaneArray
    during: LaneArray
    penetration: LaneArray
    rate: LaneArray
    new_penetration: LaneArray
    new_rate: LaneArray
    new_force: LaneArray
    late_force: LaneArray
    between: LaneArray
    sought_penetration: LaneArray
    sought_rate: LaneArray
    tolerance: LaneArray
    clock: LaneArray
    sought: LaneArray
    accepted: LaneArray
    changed: LaneArray
    shown: LaneArray


@mechanical
def in_work(run: LaneRun) -> Any:
    """The arrays of a run as `InWork`."""
    return InWork(
        lanes_of(run.y), lanes_of(run.trial), lanes_of(run.slopes), lanes_of(run.dense), lanes_of(run.kept),
        lanes_of(run.latched), lanes_of(run.during), lanes_of(run.penetration), lanes_of(run.rate),
        lanes_of(run.new_penetration), lanes_of(run.new_rate), lanes_of(run.new_force),
        lanes_of(run.late_force), lanes_of(run.between), lanes_of(run.sought_penetration),
        lanes_of(run.sought_rate), lanes_of(run.tolerance), lanes_of(run.clock), lanes_of(run.sought),
        lanes_of(run.accepted), lanes_of(run.changed), lanes_of(run.shown),
    )  # fmt: skip
