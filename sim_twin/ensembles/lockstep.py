"""Runs side by side, each as a motion of its own for whoever reads it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.side_by_side import Truths
from sim_twin.status import Status
from sim_twin.stream import Truth

Array = NDArray[np.float64]
_AT_ONCE = 8192
"""Steps; what is computed ahead for one reader waits for the others."""


def apart(truths: Truths, runs: int) -> Sequence[Truth]:
    """One Truth for each of the `runs`, to be advanced about equally far, since all move together."""
    shared = _Shared(truths, runs)
    return [_One(shared, run) for run in range(runs)]


class OneByOne:
    """Motions that nothing makes faster together; rows of a failed one are filled up with zeros."""

    def __init__(self, truths: Sequence[Truth]) -> None:
        self._truths = truths

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (truths, channels, steps)."""
        moved = [truth.advance(steps) for truth in self._truths]
        return np.array([np.pad(rows, ((0, 0), (0, steps - rows.shape[1]))) for rows in moved])

    @property
    def statuses(self) -> Sequence[Status]:
        """How each run stands."""
        return [truth.status for truth in self._truths]


class _Shared:
    def __init__(self, truths: Truths, runs: int) -> None:
        self._truths = truths
        self._ahead = [_Ahead() for _ in range(runs)]

    def take(self, run: int, steps: int) -> tuple[Array, Status]:
        ahead = self._ahead[run]
        while ahead.steps < steps:
            moved = self._truths.advance(_AT_ONCE)
            for each, fine, status in zip(self._ahead, moved, self._truths.statuses, strict=True):
                each.parts.append((fine, status))
        return ahead.take(steps)


class _Ahead:
    """What is computed for a run and not yet read, with how the run stood after each part."""

    def __init__(self) -> None:
        self.parts: list[tuple[Array, Status]] = []

    @property
    def steps(self) -> int:
        return sum(fine.shape[1] for fine, _ in self.parts)

    def take(self, steps: int) -> tuple[Array, Status]:
        rest = self.steps - steps
        fine, status = np.concatenate([fine for fine, _ in self.parts], axis=1), self.parts[-1][1]
        self.parts = [(fine[:, steps:], status)] if rest else []
        return fine[:, :steps], status


class _One:
    """A Truth; its drive was set when it was made."""

    def __init__(self, shared: _Shared, run: int) -> None:
        self._shared, self._run = shared, run
        self._status = Status.COMPLETED

    def change_drive(self, drive: Any, phase: float, reference: float) -> None:
        raise ValueError("runs side by side keep the drive that they started with")

    def advance(self, steps: int) -> Array:
        fine, self._status = self._shared.take(self._run, steps)
        return fine

    def shape(self) -> Array:
        raise ValueError("runs side by side have no picture")

    @property
    def status(self) -> Status:
        return self._status
