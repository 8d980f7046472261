"""Largest force of each half cycle, found while the rig runs."""

from __future__ import annotations

from typing import NamedTuple

from daq.block import SampleBlock
from daq.signals import half_cycles
from daq.signals.impacts import largest_force
from rig.live.recent import Recent

UPPER, LOWER = "contact.force_upper", "contact.force_lower"
"""The two channels that hold the contact forces of the impact beam."""

_WINDOW_S = 3.0
_PERIOD_S = 1.0


class Peak(NamedTuple):
    """The largest force of one half cycle and when it was."""

    time_s: float
    force_n: float


class HalfCyclePeaks:
    """Peaks of one origin; a half cycle is reported once, when the next one has begun.

    The threshold follows the largest force so far.
    """

    def __init__(self) -> None:
        self._sides = {UPPER: Recent(_WINDOW_S), LOWER: Recent(_WINDOW_S)}
        self._largest_n = 0.0
        self._reported = -1
        self._looked_s = 0.0

    def add(self, block: SampleBlock) -> list[Peak]:
        """Take a block of any channel and return the half cycles that it completed."""
        if block.channel not in self._sides:
            return []
        self._sides[block.channel].add(block)
        self._largest_n = max(self._largest_n, largest_force(block.values))
        end_s = block.end_sample / block.sample_rate
        if end_s - self._looked_s < _PERIOD_S:
            return []
        self._looked_s = end_s
        return self._look(block.sample_rate)

    def _look(self, sample_rate: float) -> list[Peak]:
        sides = self._sides.values()
        first = max(side.first_sample for side in sides)
        end = min(side.end_sample for side in sides)
        upper, lower = (side.between(first, end) for side in sides)
        found = half_cycles(upper, lower, sample_rate, self._largest_n)
        peaks = []
        for first_index, max_index, force in zip(
            found.first_index[:-1], found.max_index[:-1], found.max_n[:-1], strict=True
        ):
            if first + int(first_index) > self._reported:
                peaks.append(Peak((first + int(max_index)) / sample_rate, float(force)))
                self._reported = first + int(max_index)
        return peaks
