"""Counts impacts while they are recorded, so that a record can end with the fifteenth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from daq.signals.impact_events import BounceGrouper, ImpactDetector
from daq.signals.impacts import COUNTS_FROM, FAINTEST_N, Levels

BOUNCES_WITHIN = 0.25
"""Of a cycle of the drive: what touches the same side again so soon is a bounce of the same impact."""


class ImpactCount:
    """Impacts on several forces together, each with its bounces; true once there are `enough` of them.

    An impact counts if its largest peak passes `above` (in the channels' unit) or, where that is None, a
    tenth of the largest so far, at least 0.5 N. `cycle_s` is a cycle of the drive.
    """

    def __init__(
        self,
        channels: Sequence[str],
        enough: int,
        sample_rate: float,
        cycle_s: float,
        above: float | None = None,
    ) -> None:
        self._enough, self._above = enough, above
        level = FAINTEST_N if above is None else above
        within_s = BOUNCES_WITHIN * cycle_s
        self._sides = {
            channel: (
                ImpactDetector(Levels(level, level / 2), sample_rate),
                BounceGrouper(sample_rate, within_s),
            )
            for channel in channels
        }
        self._peaks: list[float] = []

    def __call__(self, values: Mapping[str, NDArray[np.float32]]) -> bool:
        """Take the next samples by channel, shape (n,) each; return whether there are enough impacts.

        An impact counts once no bounce of it can follow.
        """
        for channel, (detector, grouper) in self._sides.items():
            found = detector.add(values[channel])
            self._peaks += grouper.add(found, detector.settled).peak_n.tolist()
        return self.count >= self._enough

    @property
    def count(self) -> int:
        """Impacts that are over."""
        least = self._above if self._above is not None else COUNTS_FROM * max(self._peaks, default=0.0)
        return sum(peak > least for peak in self._peaks)
