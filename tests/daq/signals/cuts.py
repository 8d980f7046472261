"""A record cut into blocks at any places, empty blocks among them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from hypothesis import strategies as st


def cuts_of(samples: int) -> st.SearchStrategy[list[int]]:
    """Places, in order, at which to cut a record."""
    return st.lists(st.integers(0, samples), max_size=10).map(sorted)


def blocks(samples: int, cuts: Sequence[int]) -> Iterator[slice]:
    """The parts of a record of so many samples between the cuts."""
    return (slice(start, end) for start, end in pairwise([0, *cuts, samples]))
