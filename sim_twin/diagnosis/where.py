"""Where something sits that no cause explains: told by which channels do not fit, or not known.

What an unknown thing does to all channels resembles causes elsewhere as much as those at its own place. A
channel that is off by itself says more.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.discrepancy import Discrepancy, figures
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.gap import GapMeasure
from sim_twin.diagnosis.library import Library

NOT_KNOWN = "not known"
_FEWEST, _CLEARLY, _TOLD = 8, 1.5, 6
"""Rigs to hold it against; how many times as far off a figure does not fit; so many are told at most."""
_RARE = 0.99
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


def not_fitting(
    layout: Layout, measured: NDArray[np.floating], like: NDArray[np.floating]
) -> tuple[tuple[Discrepancy, float], ...]:
    """The figures of `measured` (blocks, numbers) that rigs as the best explanation says do not have.

    Those `like` it have shape (n, numbers). With each how many times as far off it is as one in a hundred of
    them; the farthest first. What does not differ between these at all is left out.
    """
    if len(like) < _FEWEST:
        return ()
    tolerance = np.array([cell.tolerance for cell in layout.of_numbers])
    centre, scatter = like.mean(axis=0), np.hypot(like.std(axis=0, ddof=1), tolerance)
    scatter[scatter == 0] = inf
    apart = np.mean(measured, axis=0, dtype=np.float64) - centre
    # each by its own scatter: one that is quiet else counts as much as one that is always loud
    off, usual = (apart / scatter) ** 2, ((like - centre) * len(like) / (len(like) - 1) / scatter) ** 2
    found = []
    for (channel, what, partner, octave), inside in figures(layout).items():
        rare = float(np.quantile(usual[:, inside].mean(axis=1), _RARE))
        times = float(np.sqrt(off[inside].mean() / rare)) if rare else 0.0
        if times > _CLEARLY:
            size = float(np.sqrt(np.mean(apart[inside] ** 2)))
            found.append((Discrepancy(channel, what, size, partner, octave), times))
    return tuple(sorted(found, key=lambda each: -each[1])[:_TOLD])


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
