"""Filters finely sampled signals: what keeps every n-th sample computes only those; recursive filters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import allocation_free, strict
from sim_twin.vector import LANES, fused, load, pick, spread

Array = NDArray[np.float64]
_TOGETHER = 4 * LANES


def decimated(fine: Array, taps: Array, factor: int, count: int) -> Array:
    """Return sums over j of taps[-1 - j] fine[k `factor` + j] for k = 0 ... `count` - 1, shape (count,).

    `fine` has at least (count - 1) `factor` + len(taps) samples. A sum's bits depend on its terms only.
    """
    padded = -len(taps) % _TOGETHER
    samples = np.zeros((count - 1) * factor + len(taps) + padded)
    samples[: len(samples) - padded] = fine[: len(samples) - padded]
    weights = np.concatenate([taps[::-1], np.zeros(padded)])
    kept = np.zeros(count)
    _sums(samples, weights, factor, kept)
    return kept


@allocation_free
def _sums(samples: Array, weights: Array, factor: int, kept: Array) -> None:
    for k in range(kept.size):
        one, two, three, four, at = spread(0.0), spread(0.0), spread(0.0), spread(0.0), k * factor
        for j in range(0, weights.size, 4 * LANES):
            one = fused(load(weights, j), load(samples, at + j), one)
            two = fused(load(weights, j + LANES), load(samples, at + j + LANES), two)
            three = fused(load(weights, j + 2 * LANES), load(samples, at + j + 2 * LANES), three)
            four = fused(load(weights, j + 3 * LANES), load(samples, at + j + 3 * LANES), four)
        total = (one + two) + (three + four)
        left = (pick(total, 0) + pick(total, 1)) + (pick(total, 2) + pick(total, 3))
        kept[k] = left + ((pick(total, 4) + pick(total, 5)) + (pick(total, 6) + pick(total, 7)))


# The same bits as scipy.signal.lfilter.
@strict
def second_order(b: Array, a: Array, x: Array, state: Array, y: Array) -> None:
    """Filter `x` into `y`, both (n,), by b/a of shape (3,), a[0] = 1; `state`, (2,), goes on."""
    b0, b1, b2, a1, a2 = b[0], b[1], b[2], a[1], a[2]
    one, two = state[0], state[1]
    for n in range(x.size):
        now = one + b0 * x[n]
        one = two + x[n] * b1 - now * a1
        two = x[n] * b2 - now * a2
        y[n] = now
    state[0], state[1] = one, two
