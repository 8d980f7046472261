"""Many runs of the impact beam at once, on lanes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq.signals import half_cycles
from sim_twin.rigs.impact_beam.lanes import BeamLanes
from sim_twin.rigs.impact_beam.truth import BeamTwin
from sim_twin.rigs.side_by_side import RunFigures, SideBySide
from sim_twin.sensors import OVERSAMPLED_RATE, resonance
from sim_twin.status import Status

Array = NDArray[np.float64]
_AT_ONCE = 8192
_FORCES = 4


def figures(
    twins: Sequence[BeamTwin], phases: Sequence[float], settle: float, duration: float
) -> list[RunFigures]:
    """The figures of `solver_values`, and the series `first_n` and `max_n` of all half cycles.

    At 204.8 kHz: the time of the first contact is known to half a step, 2.4 us.
    """
    lanes = BeamLanes(twins, OVERSAMPLED_RATE, phases)
    contacts = [_Contacts() for _ in twins]
    total = round((settle + duration) * OVERSAMPLED_RATE)
    for first in range(0, total, _AT_ONCE):
        force = lanes.advance(min(_AT_ONCE, total - first))[:, 0]
        touching = force != 0
        for row, where, contact in zip(force, touching, contacts, strict=True):
            contact.add(first, np.flatnonzero(where), row)
    begin = round(settle * OVERSAMPLED_RATE)
    return [
        contact.figures(begin) if status is Status.COMPLETED else RunFigures(status)
        for contact, status in zip(contacts, lanes.statuses, strict=True)
    ]


class _Contacts:
    """The samples at which the beam touches: a twentieth of a run, so that long runs fit into memory."""

    def __init__(self) -> None:
        self._indices: list[NDArray[np.intp]] = []
        self._forces: list[Array] = []

    def add(self, first: int, touching: NDArray[np.intp], force: Array) -> None:
        self._indices.append(first + touching)
        self._forces.append(force[touching])

    def figures(self, begin: int) -> RunFigures:
        """The figures of all samples from `begin` on, and of the first contact of all."""
        index, force = np.concatenate(self._indices), np.concatenate(self._forces)
        ended = np.append(np.diff(index) > 1, True)
        first = force[: 1 + int(np.argmax(ended))]
        counted = slice(int(np.searchsorted(index, begin)), None)
        apart = _apart(force[counted], ended[counted])
        cycles = half_cycles(np.maximum(apart, 0), np.maximum(-apart, 0), OVERSAMPLED_RATE)
        values = {
            "first_peak_n": _peak(np.abs(first)),
            "first_contact_s": (int(index[0]) - 0.5) / OVERSAMPLED_RATE if len(index) else None,
            "half_cycles": len(cycles),
            "first_mean_n": _mean(cycles.first_n),
            "first_sd_n": _deviation(cycles.first_n),
            "max_mean_n": _mean(cycles.max_n),
            "max_sd_n": _deviation(cycles.max_n),
        }
        return RunFigures(Status.COMPLETED, values, {"first_n": cycles.first_n, "max_n": cycles.max_n})


def _apart(force: Array, ended: NDArray[np.bool_]) -> Array:
    """The forces in order, one zero after each contact: all that peaks need of the time in between."""
    place = np.arange(len(force))
    place[1:] += np.cumsum(ended[: len(force) - 1])
    apart = np.zeros(len(force) + int(np.count_nonzero(ended)))
    apart[place] = force
    return apart


def _peak(force: Array) -> float | None:
    """Largest value of one contact's samples, refined by the parabola through it and its neighbours."""
    if not len(force):
        return None
    k = int(np.argmax(force))
    if not 0 < k < len(force) - 1:
        return float(force[k])
    before, top, after = force[k - 1 : k + 2]
    return float(top - (after - before) ** 2 / (8 * (before - 2 * top + after)))


def _mean(values: Array) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _deviation(values: Array) -> float | None:
    return float(np.std(values, ddof=1)) if len(values) > 1 else None


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
