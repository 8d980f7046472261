"""Where eight runs of a mechanism stand: arrays that their kernel changes in place, lanes last."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
GOING, SAMPLES, TRIES, RETAKEN, PHASE, SIDE, SEEKS, REACHED = range(8)
"""Rows of `counts`. `GOING`: 1 where a lane has samples to give, else 0; minus its status where it failed.
`RETAKEN`: how often a step up to an onset was tried. `REACHED`: samples whose states are known; of them
`SAMPLES` are given."""
SPARE = LANES - 1
"""Columns behind the samples that are asked for: they are written eight at a time."""


class LaneRun(NamedTuple):
    """Where eight runs stand: as in `run.Run`, with the lanes as last axis.

    `kept` is the dense output of the last step, `dense` that of the step in work. `accepted` and `changed`
    are 1 in the lanes that they hold of. `sampled` (8, n) and `sampled_latched` are states and contacts of
    each lane at its next eight samples, `shown` takes these samples of one lane, beside their numbers.
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
    sampled: Lanes
    sampled_latched: Lanes
    shown: Lanes
    counts: Index
    floor: Real
    """(8,) m/s; see `StepLimits`."""
