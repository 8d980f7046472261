"""Impacts of one channel while a run lasts, and the crank angles at which they were."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from daq.block import SampleBlock
from daq.signals import ImpactDetector, Impacts, Levels, impact_events, levels_of
from daq.signals.impacts import largest_force, no_impacts
from rig.live.crank.turns import Turns

IMPACT_HZ = 1000.0
"""A frame rings below, at 180 to 500 Hz; the blow itself lasts a tenth of a millisecond."""

_SLOWEST_RATE_HZ = 4 * IMPACT_HZ
_WITHIN_S = 2e-3
"""Of the filter's own ringing: what follows so closely is the same blow."""

_GROWS = 1.2
_FAINTEST = {"N": 0.5, "m/s2": 1.0}
"""Ten times a healthy channel's noise, and more above 1 kHz: what does not pass it is no impact."""

_QUIET = 0.4
"""Of that, where an impact has ended for certain."""


class ImpactPeaks:
    """Blows of one channel: contacts of a force, or what is left of an acceleration above 1 kHz.

    What counts follows the largest so far, as in the impacts of `daq.signals`.
    """

    def __init__(self, unit: str) -> None:
        self._is_force = unit == "N"
        self._faintest = _FAINTEST.get(unit, 0.0)
        self._end = -1
        self._largest = 0.0
        self._detector: ImpactDetector | None = None
        self._origin = 0

    def add(self, block: SampleBlock) -> Impacts:
        """Take a block and return the blows that ended, by sample index of the run."""
        if block.first_sample != self._end:
            self._detector = self._state = None
        self._end = block.end_sample
        values = self._blows(block)
        largest = largest_force(values)
        if self._detector is None or largest > _GROWS * self._largest:
            self._largest = max(largest, self._largest)
            self._detector = ImpactDetector(self._levels(), block.sample_rate)
            self._origin = block.first_sample
        found = self._detector.add(values)
        if not self._is_force:
            found = _one_each(found, block.sample_rate)
        at = self._origin
        return Impacts(
            found.index + at,
            found.start + at,
            found.end + at,
            found.peak_n,
            found.impulse_ns,
            found.contact_s,
        )

    def _levels(self) -> Levels:
        found = levels_of(self._largest)
        return Levels(
            max(found.counts_from_n, self._faintest), max(found.released_below_n, _QUIET * self._faintest)
        )

    def _blows(self, block: SampleBlock) -> NDArray[np.float64]:
        values = np.nan_to_num(block.values.astype(np.float64))
        if self._is_force:
            return values
        if block.sample_rate < _SLOWEST_RATE_HZ:
            return np.zeros_like(values)
        sections = signal.butter(4, IMPACT_HZ, "highpass", fs=block.sample_rate, output="sos")
        if self._state is None:
            self._state = signal.sosfilt_zi(sections) * values[:1]
        high, self._state = signal.sosfilt(sections, values, zi=self._state)
        return np.abs(high)

    _state: NDArray[np.float64] | None = None


def _one_each(found: Impacts, sample_rate: float) -> Impacts:
    if not len(found):
        return no_impacts()
    events = impact_events(found, sample_rate, _WITHIN_S)
    return Impacts(events.index, events.start, events.end, events.peak_n, events.impulse_ns, events.contact_s)


class Blow(NamedTuple):
    """Where in its revolution (0 to 1) a blow was, and how large."""

    place: float
    peak: float


class BlowsByAngle:
    """The newest blows of one or more channels, as soon as their crank angle is known."""

    def __init__(self, most: int) -> None:
        self._waiting: deque[tuple[int, float]] = deque(maxlen=most)
        self.newest: deque[Blow] = deque(maxlen=most)

    def add(self, found: Impacts) -> None:
        """Take blows of any of the channels."""
        self._waiting.extend(zip(found.index.tolist(), found.peak_n.tolist(), strict=True))

    def place(self, turns: Turns) -> bool:
        """Find the angles that are known by now; returns whether there were any."""
        due = sorted(blow for blow in self._waiting if blow[0] < turns.known_until)
        if not due:
            return False
        later = [blow for blow in self._waiting if blow[0] >= turns.known_until]
        self._waiting.clear()
        self._waiting.extend(later)
        where = turns.at(np.array([index for index, _ in due])) % 1.0
        for place, (_, peak) in zip(where.tolist(), due, strict=True):
            if np.isfinite(place):
                self.newest.append(Blow(place, peak))
        return True
