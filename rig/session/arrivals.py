"""How the host's clock lies against the card's, from when blocks arrive."""

from __future__ import annotations

import numpy as np
from scipy.stats import theilslopes

from daq.block import NS_PER_S
from daq.log.records import ClockRecord

_LEAST = 10
_MOST = 300


class Arrivals:
    """Arrival times of blocks; a block never arrives before its last sample was taken."""

    def __init__(self, sample_rate: float) -> None:
        self._rate = sample_rate
        self._ends: list[int] = []
        self._host_ns: list[int] = []

    def note(self, end_sample: int, host_ns: int) -> None:
        """A block that ends before `end_sample` was there at `host_ns`."""
        self._ends.append(end_sample)
        self._host_ns.append(host_ns)

    def record(self, device: str, start_ns: int) -> ClockRecord | None:
        """The host's clock against the time base that starts at `start_ns`; None from under ten blocks.

        The offset is the earliest arrival (transport included), the uncertainty what half of all blocks took
        longer; the rate is the median slope (Theil-Sen), 0 where its 95 % interval holds 0.
        """
        if len(self._ends) < _LEAST:
            return None
        every = -(-len(self._ends) // _MOST)
        base_s = np.array(self._ends[::every]) / self._rate
        late_s = (np.array(self._host_ns[::every]) - start_ns) / NS_PER_S - base_s
        fit = theilslopes(late_s, base_s)
        slope = float(fit.slope) if fit.low_slope * fit.high_slope > 0 else 0.0
        offset = float(late_s.min())
        spread = float(np.median(late_s) - offset)
        return ClockRecord(self._host_ns[-1], device, offset, slope * 1e6, spread)
