"""Many runs of one rig together: what a rig may give to ensembles besides one run at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sim_twin.status import Status

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RunFigures:
    """Figures of one run, as `RigModel.solver_values` names them; none after a failure.

    `series` holds what there are many of in a run (the peaks of all half cycles), each of shape (n,).
    """

    status: Status
    values: Mapping[str, float | int | None] = field(default_factory=dict)
    series: Mapping[str, Array] = field(default_factory=dict)


class Truths(Protocol):
    """True motions at the channels of several twins, on one grid from t = 0 on, each in its drive."""

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (twins, channels, steps), rows in the order of the channels."""

    @property
    def statuses(self) -> Sequence[Status]:
        """How each run stands; the values of one that has failed mean nothing."""


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Runs of several twins at once, each from rest with its drive at a phase (rad) at t = 0.

    A run's numbers must be the same bits in whatever company it runs.

    - `figures(twins, phases, settle, duration)`: figures of each, in order.
    - `truths(twins, phases, rate)`: their motions on a grid of `rate` Hz; all have the same channels.
    """

    figures: Callable[[Sequence[Any], Sequence[float], float, float], Sequence[RunFigures]]
    truths: Callable[[Sequence[Any], Sequence[float], float], Truths]
