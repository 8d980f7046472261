"""Fewer points that draw the same picture: the smallest and the largest sample of each bucket."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Envelope(NamedTuple):
    """Chosen samples in order of time: their indices, shape (m,), and their values, shape (m,)."""

    indices: NDArray[np.intp]
    values: NDArray[np.floating]


def envelope(values: NDArray[np.floating], maximum_points: int) -> Envelope:
    """At most `maximum_points` (at least 4) of `values`, shape (n,): the extremes of every bucket.

    The chosen samples keep their own index, so a peak stays where it was. A bucket that holds a NaN keeps it,
    so a gap stays a gap. Short arrays come back whole.
    """
    return envelopes([values], maximum_points)[0]


def envelopes(rows: Sequence[NDArray[np.floating]], maximum_points: int) -> list[Envelope]:
    """The `envelope` of each of `rows`, all of shape (n,); together they take less time."""
    count = len(rows[0])
    if count <= maximum_points:
        return [Envelope(np.arange(count), values) for values in rows]
    size = stretch_of(count, maximum_points)
    start = np.arange(0, count, size)
    full = count // size
    pairs = np.empty((len(rows), len(start), 2), dtype=np.intp)
    for pair, values in zip(pairs, rows, strict=True):
        buckets, rest = values[: full * size].reshape(-1, size), values[full * size :]
        pair[:full, 0], pair[:full, 1] = buckets.argmin(axis=1), buckets.argmax(axis=1)
        if len(rest):
            pair[full] = rest.argmin(), rest.argmax()
    pairs += start[:, np.newaxis]
    pairs.sort(axis=2)
    indices = pairs.reshape(len(rows), -1)
    new = np.diff(indices, axis=1, prepend=-1) > 0
    chosen = [each[kept] for each, kept in zip(indices, new, strict=True)]
    return [Envelope(each, values[each]) for each, values in zip(chosen, rows, strict=True)]


def stretch_of(count: int, maximum_points: int) -> int:
    """Samples in a bucket of an `envelope` of so many."""
    return -(-count // max(maximum_points // 2, 1))
