"""Fewer points that draw the same picture: the smallest and the largest sample of each bucket."""

from __future__ import annotations

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
    count = len(values)
    if count <= maximum_points:
        return Envelope(np.arange(count), values)
    size = stretch_of(count, maximum_points)
    whole = count // size * size
    buckets = values[:whole].reshape(-1, size)
    start = np.arange(0, whole, size)
    pairs = np.stack((start + buckets.argmin(axis=1), start + buckets.argmax(axis=1)), axis=1)
    if whole < count:
        rest = values[whole:]
        pairs = np.vstack((pairs, [[whole + rest.argmin(), whole + rest.argmax()]]))
    index = np.sort(pairs, axis=1).ravel()
    index = index[np.concatenate(([True], np.diff(index) > 0))]
    return Envelope(index, values[index])


def stretch_of(count: int, maximum_points: int) -> int:
    """Samples in a bucket of an `envelope` of so many."""
    return -(-count // max(maximum_points // 2, 1))
