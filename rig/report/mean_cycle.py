"""A channel's mean over all cycles of the drive: what of a waveform stays in a motion that chatters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.report.record import RunRecord, Trace

_POINTS = 400
GROWS = ".angle"
"""Such a channel is unwrapped: it has no mean cycle."""


class Cycle(NamedTuple):
    """The drive's cycle or the crank's revolution: frequency in Hz, phase at sample 0 in rad.

    `from_rest` is True where the drive began within the record.
    """

    frequency_hz: float
    phase_rad: float
    from_rest: bool


def cycle_of(run: RunRecord) -> Cycle | None:
    """The cycle that an overlay notes in its log; None where it does not, or where it makes no sense."""
    record = run.metadata.get("twin", {})
    try:
        frequency_hz, phase_rad = float(record["cycle_hz"]), float(record["cycle_phase_rad"])
    except (KeyError, ValueError):
        return None
    if not (math.isfinite(phase_rad) and 0 < frequency_hz < math.inf):
        return None
    return Cycle(frequency_hz, phase_rad, record.get("from_rest") == "true")


def mean_cycle(trace: Trace, cycle: Cycle) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shares of a cycle and the mean of all finite samples there, both of shape (m,); empty without one."""
    finite = np.flatnonzero(np.isfinite(trace.values))
    turns = finite * (cycle.frequency_hz / trace.sample_rate) + cycle.phase_rad / (2 * np.pi)
    count = max(1, min(_POINTS, round(trace.sample_rate / cycle.frequency_hz)))
    place = np.minimum((turns % 1.0 * count).astype(np.int64), count - 1)
    seen = np.bincount(place, minlength=count)
    total = np.bincount(place, trace.values[finite].astype(np.float64), count)
    filled = seen > 0
    return (np.flatnonzero(filled) + 0.5) / count, total[filled] / seen[filled]
