"""What does not fit; and where something sits that no cause explains: by what it resembles, or not known."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
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
_NEAREST, _LIKE, _UNLIKE = 3, 0.5, 0.2
"""Rigs by which a cause is held against the measurement; cosine of the angle between both from which on it
resembles that, and by how much less it is e times less likely. By eye, on campaigns of another engine with
what no catalogue holds (`python -m benchmarks.blind make DIR --sets mild strong`, seed 901)."""


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
    attribution: Attribution,
    measured: NDArray[np.floating],
    explained: NDArray[np.floating],
    causes: Sequence[Cause],
    library: Library,
) -> dict[str, float]:
    """Shares of the locations, for something that no cause explains of `measured` blocks (n, numbers).

    It sits where the causes are whose rigs lie off the healthy ones in the same direction, less what is
    `explained` (directions,). Causes that some runs ruled out are not among those that it is held against.
    """
    place = attribution.place(measured).mean(axis=0) - explained
    nearest: dict[str, float] = {}
    for cause in causes:
        if not cause.entered and library.count((cause,)):
            rigs = attribution.place(np.array([each[0] for each in library.fingerprints((cause,))]))
            sizes = np.linalg.norm(rigs, axis=1) * np.linalg.norm(place)
            cosine = float(np.sort(rigs @ place / np.maximum(sizes, 1e-9))[-_NEAREST:].mean())
            nearest[cause.location] = max(cosine, nearest.get(cause.location, -1.0))
    most = max(nearest.values(), default=0.0)
    if most < _LIKE:
        return {NOT_KNOWN: 1.0}
    weights = {location: float(np.exp((cosine - most) / _UNLIKE)) for location, cosine in nearest.items()}
    return {location: weight / sum(weights.values()) for location, weight in weights.items()}
