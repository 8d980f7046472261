"""Many runs of the impact beam at once, on lanes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.impact_beam.lane_grid import resolves
from sim_twin.rigs.impact_beam.lanes import BeamLanes
from sim_twin.rigs.impact_beam.truth import BeamTruth, BeamTwin
from sim_twin.sensors import resonance
from sim_twin.status import Status

Array = NDArray[np.float64]
_FORCES = 4
"""Channels before the accelerations: drive, upper, lower, yoke."""


class BeamTruths:
    """Rows as in `BeamTruth`, for all twins."""

    def __init__(self, twins: Sequence[BeamTwin], phases: Sequence[float], rate: float) -> None:
        self._twins, self._phases, self._rate = twins, phases, rate
        self._on_lanes = [run for run, twin in enumerate(twins) if resolves(twin.rig, rate)]
        chosen = [twins[run] for run in self._on_lanes]
        chosen_phases = [phases[run] for run in self._on_lanes]
        self._lanes = BeamLanes(chosen, rate, chosen_phases, accelerations=True) if chosen else None
        self._alone = {
            run: _truth(twins[run], phases[run], rate)
            for run in range(len(twins))
            if run not in set(self._on_lanes)
        }
        self._yokes = [resonance(each.rig.yoke_frequency, each.rig.yoke_damping, rate) for each in twins]
        self._steps = 0

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (twins, channels, steps)."""
        first, self._steps = self._steps, self._steps + steps
        rows = np.zeros((len(self._twins), len(self._twins[0].channels), steps))
        if self._lanes is not None:
            for run, moved in zip(self._on_lanes, self._lanes.advance(steps), strict=True):
                force, accelerations = moved[0], moved[1:]
                rows[run, 1], rows[run, 2] = np.maximum(force, 0), np.maximum(-force, 0)
                rows[run, _FORCES : _FORCES + len(accelerations)] = accelerations
        for run in self._on_lanes:
            drive = self._twins[run].drive
            step = 2 * np.pi * drive.frequency / self._rate
            rows[run, 0] = drive.force_at_steps(self._phases[run] + first * step, step, steps)
            rows[run, 3] = self._yokes[run](rows[run, 1] - rows[run, 2])
        for run, truth in self._alone.items():
            rows[run] = truth.advance(steps)
        return rows

    @property
    def statuses(self) -> Sequence[Status]:
        """How each run stands."""
        on_lanes = [] if self._lanes is None else self._lanes.statuses
        found = dict(zip(self._on_lanes, on_lanes, strict=True))
        return [found[run] if run in found else self._alone[run].status for run in range(len(self._twins))]


def _truth(twin: BeamTwin, phase: float, rate: float) -> BeamTruth:
    truth = BeamTruth(twin, rate)
    truth.change_drive(twin.drive, phase, 0.0)
    return truth
