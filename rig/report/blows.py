"""Impacts of a rig with a crank, in the groups in which they belong together."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from rig.derived import RECORD, from_record
from rig.report.record import ORIGINS, RunRecord
from rig.report.speed import speed_figures, speeds


@dataclass(frozen=True, slots=True)
class Blows:
    """Impacts on one group of channels: crank angles in degrees where they begin, peaks in `unit`, channels.

    All of shape (n,). An angle is NaN where nothing told it. `revolutions` are those of the run, NaN where
    they are not known.
    """

    unit: str

    angle_deg: NDArray[np.float64]
    peak: NDArray[np.float64]
    channels: tuple[str, ...]
    revolutions: float

    @property
    def a_revolution(self) -> float:
        """How many there are a revolution."""
        return len(self.peak) / self.revolutions if self.revolutions > 0 else nan

    @property
    def mean(self) -> float:
        """Mean peak, NaN without a blow."""
        return float(self.peak.mean()) if len(self.peak) else nan

    @property
    def deviation(self) -> float:
        """Standard deviation of the peaks, NaN for fewer than two."""
        return float(np.std(self.peak, ddof=1)) if len(self.peak) > 1 else nan


def blows(run: RunRecord) -> dict[str, dict[str, Blows]]:
    """Impacts by group and by whose they are; only of groups and origins whose channels the run has.

    All origins count from one level, the highest of those that each settled for itself: an origin whose
    first second was softer would count more, and softer ones.
    """
    if run.crank is None:
        return {}
    least = _least(run)
    turned = {whose: speed_figures(speed).revolutions for whose, speed in speeds(run).items()}
    found: dict[str, dict[str, Blows]] = {}
    for group, names in run.crank.heard(run.channels).items():
        found[group] = {
            run.whose(origin): _of(run, origin, names, least, turned.get(run.whose(origin), nan))
            for origin in ORIGINS
            if any((origin, name) in run.traces for name in names)
        }
    return found


def _least(run: RunRecord) -> dict[str, float]:
    """By channel, the peak from which an impact counts, in its unit."""
    least: dict[str, float] = {}
    for settings in from_record(run.metadata.get(RECORD, {})).values():
        for name, levels in settings.levels.items():
            least[name] = max(least.get(name, 0.0), levels.counts_from_n)
    return least


def _of(
    run: RunRecord, origin: str, names: tuple[str, ...], least: dict[str, float], revolutions: float
) -> Blows:
    chosen = [
        each
        for each in run.impacts
        if each.origin == origin and each.channel in names and each.peak >= least.get(each.channel, 0.0)
    ]
    turns = np.array([each.turns for each in chosen], dtype=np.float64)
    return Blows(
        unit=run.channels[names[0]].unit,
        angle_deg=360.0 * (turns % 1.0),
        peak=np.array([each.peak for each in chosen], dtype=np.float64),
        channels=tuple(each.channel for each in chosen),
        revolutions=revolutions,
    )
