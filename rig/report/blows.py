"""Impacts of a rig with a crank, in the groups in which they belong together."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from daq.log.reader import Origin
from rig.derived.settings import RECORD, from_record
from rig.report.record import ORIGINS, RunRecord
from rig.report.speed import speed_figures, speeds

_Levels = dict[tuple[str, str], float]
"""By origin and channel, the peak from which an impact counts, in the channel's unit."""


@dataclass(frozen=True, slots=True)
class Blows:
    """Impacts on one group of channels: crank angles in degrees where they begin, peaks in `unit`, channels.

    All of shape (n,). An angle is NaN where nothing told it. `revolutions` are those of the run, NaN where
    they are not known. `counts_from` is the peak from which an impact counts, in `unit`, on the channel where
    it is least and on the one where it is largest; NaN where the log does not tell.
    """

    unit: str

    angle_deg: NDArray[np.float64]
    peak: NDArray[np.float64]
    channels: tuple[str, ...]
    revolutions: float
    counts_from: tuple[float, float]

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
    first second was softer would count more, and softer ones. Where nothing that was measured on a channel
    reaches that, a twin that strikes far too hard must not hide it: there each origin counts from its own.
    """
    if run.crank is None:
        return {}
    levels = _levels(run)
    turned = {whose: speed_figures(speed).revolutions for whose, speed in speeds(run).items()}
    found: dict[str, dict[str, Blows]] = {}
    for group, names in run.crank.heard(run.channels).items():
        found[group] = {
            run.whose(origin): _of(run, origin, names, levels, turned.get(run.whose(origin), nan))
            for origin in ORIGINS
            if any((origin, name) in run.traces for name in names)
        }
    return found


def _levels(run: RunRecord) -> _Levels:
    settings = from_record(run.metadata.get(RECORD, {}))
    own = {
        (origin, name): levels.counts_from_n
        for origin, each in settings.items()
        for name, levels in each.levels.items()
    }
    return own | {
        (origin, name): common
        for name, common in _common(own).items()
        if ("measured", name) not in own or _measured_reach(run, name, common)
        for origin in ORIGINS
        if (origin, name) in own
    }


def _common(own: _Levels) -> dict[str, float]:
    """The highest level of each channel."""
    common: dict[str, float] = {}
    for (_, name), level in own.items():
        common[name] = max(common.get(name, 0.0), level)
    return common


def _measured_reach(run: RunRecord, channel: str, level: float) -> bool:
    return any(
        each.peak >= level for each in run.impacts if (each.origin, each.channel) == ("measured", channel)
    )


def _of(run: RunRecord, origin: Origin, names: tuple[str, ...], levels: _Levels, revolutions: float) -> Blows:
    chosen = [
        each
        for each in run.impacts
        if each.origin == origin
        and each.channel in names
        and each.peak >= levels.get((origin, each.channel), 0.0)
    ]
    turns = np.array([each.turns for each in chosen], dtype=np.float64)
    known = [levels[origin, name] for name in names if (origin, name) in levels]
    return Blows(
        unit=run.channels[names[0]].unit,
        angle_deg=360.0 * (turns % 1.0),
        peak=np.array([each.peak for each in chosen], dtype=np.float64),
        channels=tuple(each.channel for each in chosen),
        revolutions=revolutions,
        counts_from=(min(known, default=nan), max(known, default=nan)),
    )
