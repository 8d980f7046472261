"""Where something sits that no cause explains: told by which channels do not fit, or not known.

What an unknown thing does to all channels resembles causes elsewhere as much as those at its own place. A
channel that is off by itself says more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.gap import GapMeasure
from sim_twin.diagnosis.library import Library

NOT_KNOWN = "not known"
_OFF = 1.6
"""Gap of a channel by itself; of ten healthy rigs about one has such a channel."""


def alone_off(measures: Sequence[GapMeasure], measured: NDArray[np.floating]) -> str:
    """The one channel that does not fit some twin of which all others do; empty where there is none.

    `measured` has shape (blocks, numbers).
    """
    for measure in measures:
        gaps = {name: np.sqrt(np.mean(each**2)) for name, each in measure.of_channels(measured).items()}
        off = [name for name, gap in gaps.items() if gap > _OFF]
        if len(off) == 1 and len(gaps) > 1:
            return off[0]
    return ""


def where_unknown(
    measure: GapMeasure, channel: str, causes: Sequence[Cause], library: Library
) -> dict[str, float]:
    """Shares of the locations, for something of which `channel` alone tells (empty: all do).

    Each as often as rigs with its causes in, of those that were simulated, are off in that channel alone.
    """
    shares: dict[str, float] = {}
    for cause in causes if channel else ():
        if cause.channel in (None, channel) and library.count((cause,)):
            rigs = np.array([each[0] for each in library.fingerprints((cause,))])
            off = {name: gaps > _OFF for name, gaps in measure.of_channels(rigs).items()}
            alone = off[channel] & (np.sum([*off.values()], axis=0) == 1)
            shares[cause.location] = shares.get(cause.location, 0.0) + float(np.mean(alone))
    total = sum(shares.values())
    return {location: share / total for location, share in shares.items()} if total else {NOT_KNOWN: 1.0}
