"""A mechanism in motion: advance it, read its outputs, change its parameters on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from sim_twin.mechanisms.run import (
    BEFORE,
    EPISODES,
    NOW,
    SAMPLES,
    STARTED,
    STEPS,
    Real,
    Run,
    StepLimits,
    begin,
)
from sim_twin.status import Status

P = TypeVar("P")
Entry = Callable[[P, Run, StepLimits, float, Real, Real], int]
"""run(p, state, limits, dt, out, episodes): a rig's compiled call of `integrate`."""
_EPISODES_A_SECOND = 5000


@dataclass(frozen=True, slots=True)
class Trace:
    """Outputs (outputs, n) at start + k `step` s; fewer columns than asked for where `status` is no success.

    `episodes` (k, 5): the contacts that ended, each with onset s, contact, approach m/s, peak N, end s.
    """

    start: float
    step: float
    outputs: Real
    episodes: Real
    status: Status


class Simulation(Generic[P]):
    """One run of a mechanism from state `y` at t = 0, sampled every `step` s."""

    def __init__(
        self, entry: Entry[P], parameters: P, y: Real, contacts: int, outputs: int, limits: StepLimits,
        step: float,
    ) -> None:  # fmt: skip
        self.parameters, self.limits, self.step = parameters, limits, step
        self._entry, self._outputs = entry, outputs
        self._run = begin(y, contacts)
        self._status = _status_of(y)

    @property
    def time(self) -> float:
        """Time of the next sample, s."""
        return float(self._run.counts[SAMPLES] * self.step)

    @property
    def steps(self) -> int:
        return int(self._run.counts[STEPS])

    @property
    def state(self) -> Real:
        """State at the end of the last step (n,), at or just past `time`."""
        return self._run.y.copy()

    @property
    def open_episodes(self) -> Real:
        """The contacts that have not ended, as rows of `Trace.episodes` without an end."""
        return np.asarray(self._run.open_episode[self._run.latched > 0.0])

    def present(self) -> Real:
        """State at `time` (n,), from the dense output of the step around it."""
        run = self._run
        span = run.clock[NOW] - run.clock[BEFORE]
        if not run.counts[STARTED] or span <= 0.0:
            return run.y.copy()
        x = (self.time - run.clock[BEFORE]) / span
        c = run.dense
        return np.asarray(c[0] + x * (c[1] + (1 - x) * (c[2] + x * (c[3] + (1 - x) * c[4]))))

    def change(self, parameters: P, y: Real) -> None:
        """Go on from the present with other parameters, from state `y`; what touches keeps its approach."""
        run = self._run
        run.y[:] = y
        run.latched[:] = run.during
        run.clock[NOW] = run.clock[BEFORE] = self.time
        run.counts[STARTED] = 0
        self.parameters = parameters
        if self._status is Status.COMPLETED:
            self._status = _status_of(y)

    def advance(self, count: int) -> Trace:
        """Advance by `count` samples; after a failure there are no more."""
        start, out = self.time, np.zeros((self._outputs, count))
        if self._status is not Status.COMPLETED:
            return Trace(start, self.step, out[:, :0], np.zeros((0, 5)), self._status)
        before = int(self._run.counts[SAMPLES])
        episodes = np.zeros((1000 + int(count * self.step * _EPISODES_A_SECOND), 5))
        seconds = max(1.0, count * self.step)
        limits = self.limits._replace(budget=int(self.limits.budget * seconds))
        code = self._entry(self.parameters, self._run, limits, self.step, out, episodes)
        self._status = Status(code)
        reached = int(self._run.counts[SAMPLES]) - before
        return Trace(start, self.step, out[:, :reached], episodes[: self._run.counts[EPISODES]], self._status)


def _status_of(y: Real) -> Status:
    return Status.COMPLETED if np.isfinite(y).all() else Status.DIVERGED
