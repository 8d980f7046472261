"""Many runs of the impact beam at once, on lanes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.impact_beam.lane_figures import figures
from sim_twin.rigs.impact_beam.lanes import BeamLanes
from sim_twin.rigs.impact_beam.truth import BeamTwin
from sim_twin.rigs.side_by_side import SideBySide
from sim_twin.sensors import resonance
from sim_twin.status import Status

Array = NDArray[np.float64]
_FORCES = 4
"""Channels before the accelerations: drive, upper, lower, yoke."""


class BeamTruths:
    """Rows as in `BeamTruth`, for all twins."""

    def __init__(self, twins: Sequence[BeamTwin], phases: Sequence[float], rate: float) -> None:
        self._twins, self._phases, self._rate = twins, phases, rate
        self._lanes = BeamLanes(twins, rate, phases, accelerations=True)
        self._yokes = [resonance(each.rig.yoke_frequency, each.rig.yoke_damping, rate) for each in twins]
        self._steps = 0

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (twins, channels, steps)."""
        seconds = np.arange(self._steps, self._steps + steps) / self._rate
        self._steps += steps
        moved = self._lanes.advance(steps)
        force, accelerations = moved[:, 0], moved[:, 1:]
        rows = np.zeros((len(self._twins), len(self._twins[0].channels), steps))
        rows[:, 1], rows[:, 2] = np.maximum(force, 0), np.maximum(-force, 0)
        rows[:, _FORCES : _FORCES + accelerations.shape[1]] = accelerations
        for row, twin, phase, yoke in zip(rows, self._twins, self._phases, self._yokes, strict=True):
            row[0] = twin.drive.force(2 * np.pi * twin.drive.frequency * seconds + phase)
            row[3] = yoke(row[1] - row[2])
        return rows

    @property
    def statuses(self) -> Sequence[Status]:
        """How each run stands."""
        return self._lanes.statuses


SIDE_BY_SIDE = SideBySide(figures, BeamTruths)
