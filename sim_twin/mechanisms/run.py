"""Where the integration of a mechanism stands: arrays that its kernel changes in place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Index = NDArray[np.int64]

# Rows of Run.slopes: the seven slopes of a Dormand-Prince step; of Run.dense: its five coefficients.
STAGES, COEFFICIENTS = 7, 5
# Entries of Run.clock, s (the last is dimensionless).
NOW, BEFORE, STEP, STEP_BEFORE_ONSET, ERROR = range(5)
# Entries of Run.counts.
STEPS, REJECTED, SAMPLES, STARTED, EPISODES = range(5)
FIRST_STEP, FIRST_ERROR = 1e-6, 1e-2
# Columns of an episode, one row for each contact that has ended.
ONSET, CONTACT, APPROACH, PEAK, END = range(5)


class Run(NamedTuple):
    """State `y` (n,) at the end of the last step, and what is needed to go on from there bit by bit alike.

    Over the contacts: `latched` approach speed (0 where open) in m/s, `penetration` in m and its `rate`,
    normal `force` in N, all at the end of the step; `during` is `latched` within the step. `open_episode` is
    ONSET ... END. `new_...` belong to the step in work, `late_force` to a stage of it, `between` and
    `sought_...` to a search in it.
    """

    y: Real
    trial: Real
    slopes: Real
    dense: Real
    latched: Real
    during: Real
    penetration: Real
    rate: Real
    new_penetration: Real
    new_rate: Real
    new_force: Real
    between: Real
    sought_penetration: Real
    sought_rate: Real
    sought_force: Real
    force: Real
    late_force: Real
    open_episode: Real
    clock: Real
    counts: Index


class StepLimits(NamedTuple):
    """`tolerance` (n,): error that a step may make in each state; steps in s.

    `after_onset` is the first step in a new contact; `floor` the least approach speed in m/s that a contact
    latches; `reach` the penetration in m within which an onset is located; `budget` how many steps a call may
    take for each simulated second, and at least.
    """

    tolerance: Real
    longest: float
    shortest: float
    after_onset: float
    floor: float
    reach: float
    budget: int


def begin(y: Real, contacts: int, time: float = 0.0, step: float = FIRST_STEP) -> Run:
    """A run that starts from state `y` (n,) at `time` s, with a first trial `step` s; sample 0 is `time`."""
    n = len(y)
    clock = np.array([time, time, step, step, FIRST_ERROR])
    return Run(
        y=np.array(y, dtype=float),
        trial=np.zeros(n),
        slopes=np.zeros((STAGES, n)),
        dense=np.zeros((COEFFICIENTS, n)),
        latched=np.zeros(contacts),
        during=np.zeros(contacts),
        penetration=np.zeros(contacts),
        rate=np.zeros(contacts),
        new_penetration=np.zeros(contacts),
        new_rate=np.zeros(contacts),
        new_force=np.zeros(contacts),
        between=np.zeros(n),
        sought_penetration=np.zeros(contacts),
        sought_rate=np.zeros(contacts),
        sought_force=np.zeros(contacts),
        force=np.zeros(contacts),
        late_force=np.zeros(contacts),
        open_episode=np.zeros((contacts, 5)),
        clock=clock,
        counts=np.zeros(5, dtype=np.int64),
    )
