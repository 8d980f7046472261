"""Contacts of a force in one pass over its samples, however these are cut into blocks."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

START, END, INDEX, PEAK, SUM = range(5)
"""Columns of a contact: first sample, end (excluded), sample of the peak, peak, sum of its samples."""

_OPEN, _COUNT = 5, 6


class ContactScanner:
    """Contacts above a level; one begins with the first sample above it and ends with the first that is not.

    Sums are taken one by one, so that they do not depend on the cuts. What is not finite is no contact.
    """

    def __init__(self, above: float) -> None:
        self._above = above
        self._state = np.zeros(7)

    @property
    def count(self) -> int:
        """Samples seen so far."""
        return int(self._state[_COUNT])

    @property
    def open_since(self) -> int | None:
        """First sample of the contact that lasts."""
        return int(self._state[START]) if self._state[_OPEN] else None

    def add(self, force: NDArray[np.floating]) -> NDArray[np.float64]:
        """Take the next samples, shape (n,); return the contacts that ended, shape (contacts, 5)."""
        locked = np.ascontiguousarray(force).view()
        locked.flags.writeable = False  # one compiled kernel for blocks of a card and of a log
        rows = np.empty((len(force) // 2 + 1, 5))
        return rows[: _scan(locked, self._above, self._state, rows)]

    def finish(self) -> NDArray[np.float64]:
        """The contact that the end of the record cuts, shape (0 or 1, 5)."""
        if not self._state[_OPEN]:
            return np.empty((0, 5))
        self._state[_OPEN], self._state[END] = 0.0, self._state[_COUNT]
        return self._state[None, :5].copy()


@njit(cache=True, nogil=True)
def _scan(
    force: NDArray[np.floating], above: float, state: NDArray[np.float64], rows: NDArray[np.float64]
) -> int:
    start, index, peak, total = state[0], state[2], state[3], state[4]
    is_open, first = state[5] != 0.0, state[6]
    found = 0
    for at in range(len(force)):
        value = np.float64(force[at])
        if value > above:
            if not is_open:
                is_open, start, peak, total = True, first + at, -np.inf, 0.0
            total += value
            if value > peak:
                peak, index = value, first + at
        elif is_open:
            is_open = False
            rows[found, 0], rows[found, 1], rows[found, 2] = start, first + at, index
            rows[found, 3], rows[found, 4] = peak, total
            found += 1
    state[0], state[2], state[3], state[4] = start, index, peak, total
    state[5], state[6] = 1.0 if is_open else 0.0, first + len(force)
    return found
