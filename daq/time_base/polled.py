"""When a polled value was taken: a drive without a clock answers some time between request and reply."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from daq.log.records import ClockRecord

_COVERED = 0.95


def polled_clock(device: str, request_s: ArrayLike, reply_s: ArrayLike, time_ns: int) -> ClockRecord:
    """How the replies of a polled device lie against the time base, as of `time_ns`.

    `request_s`, `reply_s`: times on the time base, shape (n,), n at least 1. The offset leads from a reply
    to the middle of a usual poll. The uncertainty needs no assumption on where in between the value was
    taken: it is a bound for 95 % of the polls. A device without a clock has no rate: 0.
    """
    taken = np.asarray(reply_s, np.float64) - np.asarray(request_s, np.float64)
    half = float(np.median(taken)) / 2
    return ClockRecord(time_ns, device, -half, 0.0, max(half, float(np.quantile(taken, _COVERED)) - half))
