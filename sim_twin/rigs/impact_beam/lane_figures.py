"""Figures of many runs of the impact beam, computed on lanes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from daq.signals.impacts import half_cycles
from sim_twin.rigs.impact_beam.lane_grid import resolves
from sim_twin.rigs.impact_beam.lanes import BeamLanes
from sim_twin.rigs.impact_beam.solver_values import run_figures
from sim_twin.rigs.impact_beam.truth import BeamTwin
from sim_twin.rigs.side_by_side import RunFigures
from sim_twin.sensors import OVERSAMPLED_RATE
from sim_twin.status import Status

Array = NDArray[np.float64]
_AT_ONCE = 8192
"""Steps; the forces of a piece of work then stay in the second cache."""


def figures(
    twins: Sequence[BeamTwin], phases: Sequence[float], settle: float, duration: float
) -> list[RunFigures]:
    """The figures of each run: on lanes where their step resolves its contact, else by the exact solver."""
    on_lanes = [run for run, twin in enumerate(twins) if resolves(twin.rig, OVERSAMPLED_RATE)]
    found = (
        dict(
            zip(
                on_lanes,
                _side_by_side(
                    [twins[run] for run in on_lanes], [phases[run] for run in on_lanes], settle, duration
                ),
                strict=True,
            )
        )
        if on_lanes
        else {}
    )
    return [
        found[run] if run in found else _alone(twin, phase, settle, duration)
        for run, (twin, phase) in enumerate(zip(twins, phases, strict=True))
    ]


def _alone(twin: BeamTwin, phase: float, settle: float, duration: float) -> RunFigures:
    try:
        return run_figures(twin, phase, settle, duration)
    except SimulationFailed as failure:
        ended = failure.status
        return RunFigures(ended if isinstance(ended, Status) else Status.DIVERGED)


def _side_by_side(
    twins: Sequence[BeamTwin], phases: Sequence[float], settle: float, duration: float
) -> list[RunFigures]:
    """The figures of `solver_values`, and the series `first_n` and `max_n` of all half cycles.

    At 204.8 kHz: the time of the first contact is known to half a step, 2.4 us.
    """
    lanes = BeamLanes(twins, OVERSAMPLED_RATE, phases)
    firsts, contacts = [_FirstContact() for _ in twins], _Contacts(len(twins))
    begin, end = round(settle * OVERSAMPLED_RATE), round((settle + duration) * OVERSAMPLED_RATE)
    for start, stop in [*_blocks(0, begin), *_blocks(begin, end)]:
        force = lanes.advance(stop - start)[:, 0]
        for row, first in zip(force, firsts, strict=True):
            first.add(start, row)
        if start >= begin:
            contacts.add(force)
    return [
        _figures(first, contacts.peaks(run)) if status is Status.COMPLETED else RunFigures(status)
        for run, (first, status) in enumerate(zip(firsts, lanes.statuses, strict=True))
    ]


def _blocks(begin: int, end: int) -> list[tuple[int, int]]:
    return [(start, min(start + _AT_ONCE, end)) for start in range(begin, end, _AT_ONCE)]


def _figures(first: _FirstContact, peaks: Array) -> RunFigures:
    cycles = half_cycles(np.maximum(peaks, 0), np.maximum(-peaks, 0), OVERSAMPLED_RATE)
    values = {
        "first_peak_n": first.peak(),
        "first_contact_s": first.seconds,
        "half_cycles": len(cycles),
        "first_mean_n": _mean(cycles.first_n),
        "first_sd_n": _deviation(cycles.first_n),
        "max_mean_n": _mean(cycles.max_n),
        "max_sd_n": _deviation(cycles.max_n),
    }
    return RunFigures(Status.COMPLETED, values, {"first_n": cycles.first_n, "max_n": cycles.max_n})


class _FirstContact:
    """All samples of a run's first contact."""

    def __init__(self) -> None:
        self.seconds: float | None = None
        self._parts: list[Array] = []
        self._over = False

    def add(self, start: int, force: Array) -> None:
        if self._over:
            return
        begin = 0
        if self.seconds is None:
            begin = int(np.argmax(force != 0))
            if force[begin] == 0:
                return
            self.seconds = (start + begin - 0.5) / OVERSAMPLED_RATE
        free = force[begin:] == 0
        self._over = bool(free.any())
        self._parts.append(
            np.abs(force[begin : begin + int(np.argmax(free))] if self._over else force[begin:])
        )

    def peak(self) -> float | None:
        """Largest force in N, refined by the parabola through it and its neighbours."""
        if not self._parts:
            return None
        force = np.concatenate(self._parts)
        k = int(np.argmax(force))
        if not 0 < k < len(force) - 1:
            return float(force[k])
        before, top, after = force[k - 1 : k + 2]
        return float(top - (after - before) ** 2 / (8 * (before - 2 * top + after)))


class _Contacts:
    """The peak of every contact, block by block: of a long run all that half cycles need."""

    def __init__(self, runs: int) -> None:
        self._peaks: list[list[Array]] = [[] for _ in range(runs)]
        self._touching = np.zeros(runs, dtype=bool)

    def add(self, force: Array) -> None:
        """Take the next samples of all runs, shape (runs, n), upper minus lower force."""
        touching = np.flatnonzero(force != 0)
        lanes = np.searchsorted(touching, np.arange(len(force) + 1) * force.shape[1])
        new = np.diff(touching, prepend=-2) > 1
        new[lanes[:-1][lanes[:-1] < len(touching)]] = True
        begins = np.flatnonzero(new)
        peaks = _signed_peaks(force.ravel()[touching], begins)
        parts = np.searchsorted(begins, lanes)
        carried = self._touching & (force[:, 0] != 0)
        for run, (first, last) in enumerate(pairwise(parts)):
            self._peaks[run].append(_apart(peaks[first:last], bool(carried[run])))
        self._touching = force[:, -1] != 0

    def peaks(self, run: int) -> Array:
        """Signed peaks of a run in N, with a zero between contacts."""
        return np.concatenate([np.zeros(0), *self._peaks[run]])


def _signed_peaks(force: Array, begins: NDArray[np.intp]) -> Array:
    if not len(begins):
        return np.zeros(0)
    return np.asarray(np.maximum.reduceat(np.abs(force), begins) * np.sign(force[begins]))


def _apart(peaks: Array, carried: bool) -> Array:
    """A zero before each peak, but none where the first goes on with the contact that was there before."""
    apart = np.zeros(2 * len(peaks))
    apart[1::2] = peaks
    return apart[1:] if carried else apart


def _mean(values: Array) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _deviation(values: Array) -> float | None:
    return float(np.std(values, ddof=1)) if len(values) > 1 else None
