"""Looks eight fine steps ahead at once, one in each lane of a vector, for events and output up to them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import allocation_free_inlined
from sim_twin.vector import (
    LANES,
    Vector,
    first_positive,
    fused,
    load,
    pick,
    repeated,
    spread,
    store,
    where_positive,
)

Real = NDArray[np.float64]


@allocation_free_inlined
def _coming(ahead: Real, r: int, constant: float, s: Real, b: int) -> Vector:
    """The first condition of regime r one to eight fine steps from now, if the regime lasts."""
    size = ahead.shape[1]
    at, y = r * size * LANES, b * size
    one, two, three, four = spread(constant), spread(0.0), spread(0.0), spread(0.0)
    for _ in range(0, size, 4):
        one = fused(load(ahead, at), repeated(s, y), one)
        two = fused(load(ahead, at + LANES), repeated(s, y + 1), two)
        three = fused(load(ahead, at + 2 * LANES), repeated(s, y + 2), three)
        four = fused(load(ahead, at + 3 * LANES), repeated(s, y + 3), four)
        at, y = at + 4 * LANES, y + 4
    return (one + two) + (three + four)


@allocation_free_inlined
def look_ahead(
    ahead: Real, opposite: Real, r: int, constant: float, s: Real, b: int, out: Real, line: int, column: int
) -> tuple[int, float]:
    """Look for events at the next eight fine steps; record minus the first condition up to there.

    Returns which step of 1, 2, 4 or 8 fine ones can be taken at once (its power of two; -1: none), and the
    first condition after it.
    """
    coming = _coming(ahead, r, constant, s, b)
    other = fused(spread(opposite[r, 2]), coming, spread(opposite[r, 1]))
    passed = first_positive(where_positive(coming - other, coming, other))
    if passed == 0:
        return -1, 0.0
    if passed == LANES:
        if line >= 0:
            store(out, line * out.shape[1] + column + 1, spread(0.0) - coming)
        return 3, pick(coming, LANES - 1)
    power = (passed > 1) + (passed > 3)
    if line >= 0:
        for k in range((1 << power) - 1):
            out[line, column + 1 + k] = -pick(coming, k)
    return power, pick(coming, (1 << power) - 1)
