"""A record cut into blocks at any places, empty blocks among them, and the turns of its samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from hypothesis import strategies as st

from daq.signals.even_angles import AngleSampler, EvenAngles


def cuts_of(samples: int) -> st.SearchStrategy[list[int]]:
    """Places, in order, at which to cut a record."""
    return st.lists(st.integers(0, samples), max_size=10).map(sorted)


def blocks(samples: int, cuts: Sequence[int]) -> Iterator[slice]:
    """The parts of a record of so many samples between the cuts."""
    return (slice(start, end) for start, end in pairwise([0, *cuts, samples]))


def drive_turns(count: int, sample_rate: float, frequency: float, phase: float = 0.0) -> np.ndarray:
    """Turns of samples under a drive of constant frequency, whose phase (rad) is that at sample 0."""
    return np.arange(count) * (frequency / sample_rate) + phase / (2 * np.pi)


def to_even_angles(
    values: np.ndarray, turns: np.ndarray, points: int, flagged: np.ndarray | None = None
) -> EvenAngles:
    """What `AngleSampler` finds in a whole record, without the NaN at its start."""
    first, found = AngleSampler(points).add(values, turns, flagged)
    known = np.isfinite(np.atleast_2d(found)).any(axis=0)
    start = int(np.argmax(known)) if known.any() else found.shape[-1]
    return EvenAngles(first + start, found[..., start:])
