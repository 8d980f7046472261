"""Runs of a mechanism side by side: as many as there are, in groups of eight of one kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_twin.lane_array import packed, shapes
from sim_twin.mechanisms.integrator import DIVERGED
from sim_twin.mechanisms.lane_run import (
    ERROR,
    FIRST,
    GOING,
    REACHED,
    SAMPLES,
    SPARE,
    SQUARED,
    STEP,
    STEP_BEFORE_ONSET,
    TRIED,
    LaneRun,
    Lanes,
)
from sim_twin.mechanisms.run import COEFFICIENTS, FIRST_ERROR, FIRST_STEP, STAGES, Real, StepLimits
from sim_twin.status import Status
from sim_twin.vector import LANES, aligned

_OF_CONTACTS = ("latched", "during", "penetration", "rate", "new_penetration", "new_rate", "new_force",
                "late_force", "sought_penetration", "sought_rate")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Lane:
    """A run: its parameters, its state at t = 0 (n,), how finely it is integrated."""

    parameters: Any
    y: Real
    limits: StepLimits


@dataclass(frozen=True, slots=True)
class Kernel:
    """A rig's compiled calls of `begin_lanes` and `advance_lanes`, and how much there is of what."""

    begin: Callable[[Any, Lanes, LaneRun, StepLimits], None]
    advance: Callable[[Any, Lanes, Lanes, LaneRun, StepLimits, float, int, Real], None]
    contacts: int
    outputs: int


class LaneSimulation:
    """Runs of one mechanism side by side, sampled every `step` s from t = 0 on."""

    def __init__(self, kernel: Kernel, lanes: Sequence[Lane], step: float) -> None:
        self._kernel, self._step, self._samples = kernel, step, 0
        self._statuses = [Status.COMPLETED] * len(lanes)
        kinds: dict[tuple[object, ...], list[int]] = {}
        for number, lane in enumerate(lanes):
            in_common = lane.limits._replace(tolerance=np.empty(0), floor=0.0)  # these two are a lane's own
            kind = (len(lane.y), *shapes(lane.parameters), *in_common[1:])
            kinds.setdefault(kind, []).append(number)
        self._groups = [
            _Group(kernel, [lanes[number] for number in alike[first : first + LANES]], alike[first:])
            for alike in kinds.values()
            for first in range(0, len(alike), LANES)
        ]
        for group in self._groups:
            for number, status in group.statuses:
                self._statuses[number] = status

    @property
    def statuses(self) -> Sequence[Status]:
        """How each run is doing."""
        return tuple(self._statuses)

    def advance(self, count: int) -> list[Real]:
        """Return the next `count` samples of each run, (outputs, count), there until the next call.

        They are zero where a run has failed.
        """
        found = [np.empty(0)] * len(self._statuses)
        for group in self._groups:
            for number, rows in group.advance(self._step, self._samples, count):
                found[number] = rows
            for number, status in group.statuses:
                self._statuses[number] = status
        self._samples += count
        return found


class _Group:
    """Up to eight lanes of one kind; copies of the first fill the places that are left."""

    def __init__(self, kernel: Kernel, lanes: Sequence[Lane], numbers: Sequence[int]) -> None:
        self._kernel, self._numbers = kernel, numbers[: len(lanes)]
        self._limits, self._like = lanes[0].limits, lanes[0].parameters
        full = [*lanes, *[lanes[0]] * (LANES - len(lanes))]
        self._table = packed([each.parameters for each in full])
        self._each = aligned((LANES, *self._table.shape))
        self._each[:] = self._table.T[:, :, None]
        self._run, self._out = _begun(full, kernel), np.empty((0, 0, 0))
        kernel.begin(self._like, self._table, self._run, self._limits)

    @property
    def statuses(self) -> Iterator[tuple[int, Status]]:
        """Number and status of each."""
        for lane, number in enumerate(self._numbers):
            code = int(self._run.counts[GOING, lane])
            yield number, Status(-code) if code < 0 else Status.COMPLETED

    def advance(self, step: float, first: int, count: int) -> Iterator[tuple[int, Real]]:
        """Number and samples of each."""
        if self._out.shape[2] != count + SPARE:
            self._out = np.empty((LANES, self._kernel.outputs, count + SPARE))
        out = self._out
        limits = self._limits._replace(budget=int(self._limits.budget * max(1.0, count * step)))
        self._kernel.advance(self._like, self._table, self._each, self._run, limits, step, first, out)
        for lane, number in enumerate(self._numbers):
            reached = int(self._run.counts[SAMPLES, lane]) - first
            out[lane, :, max(reached, 0) :] = 0.0
            yield number, out[lane, :, :count]


def _begun(lanes: Sequence[Lane], kernel: Kernel) -> LaneRun:
    n = len(lanes[0].y)
    clock, states, tolerance = aligned((SQUARED + 1, LANES)), aligned((n, LANES)), aligned((n, LANES))
    clock[STEP] = clock[TRIED] = clock[STEP_BEFORE_ONSET] = FIRST_STEP
    clock[ERROR] = FIRST_ERROR
    shown = aligned((kernel.outputs, 2, LANES))
    shown[0, 0] = np.arange(LANES)
    states[:] = np.transpose([each.y for each in lanes])
    tolerance[:] = np.transpose([each.limits.tolerance for each in lanes])
    contacts = {name: aligned((kernel.contacts, LANES)) for name in _OF_CONTACTS}
    counts = np.zeros((REACHED + 1, LANES), dtype=np.int64)
    counts[GOING, ~np.isfinite(states).all(axis=0)] = -DIVERGED
    return LaneRun(
        **contacts,
        y=states,
        trial=aligned((n, LANES)),
        slopes=aligned((STAGES, n, LANES)),
        dense=aligned((COEFFICIENTS, n, LANES)),
        kept=aligned((COEFFICIENTS, n, LANES)),
        between=aligned((n, LANES)),
        tolerance=tolerance,
        clock=clock,
        sought=aligned((FIRST + 1, LANES)),
        accepted=aligned((1, LANES)),
        changed=aligned((1, LANES)),
        sampled=aligned((LANES, n, LANES)),
        sampled_latched=aligned((LANES, kernel.contacts, LANES)),
        shown=shown,
        counts=counts,
        floor=np.array([each.limits.floor for each in lanes]),
    )
