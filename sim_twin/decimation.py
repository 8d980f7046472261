"""Filters finely sampled signals: what keeps every n-th sample computes only those; recursive filters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import allocation_free, allocation_free_inlined, strict
from sim_twin.vector import LANES, fused, load, spread, store

Array = NDArray[np.float64]
_OUTPUTS = 4 * LANES
"""Computed at a time."""
_NOTHING = 1e-16
"""A tap of a half-band filter that is only rounded off zero."""


def decimated(fine: Array, taps: Array, factor: int, count: int) -> Array:
    """Return sums over j of taps[-1 - j] fine[k `factor` + j] for k = 0 ... `count` - 1, shape (count,).

    `fine` has at least (count - 1) `factor` + len(taps) samples. A sum's bits depend on its terms only.
    """
    samples = (count - 1) * factor + len(taps)
    decimation = Decimation(taps, factor, np.zeros(1, np.bool_), held=0)
    return np.asarray(decimation.advance(fine[None, :samples], count)[0])


class Decimation:
    """Every `factor`-th sample of rows of signals that are filtered by `taps`, as they come.

    Rows that are `plain` (bool, (rows,)) are taken as they are where the middle of the taps lies. So many
    zeros as are `held` come before the first samples.
    """

    def __init__(self, taps: Array, factor: int, plain: NDArray[np.bool_], held: int) -> None:
        self._factor, self._taps, self._plain = factor, len(taps), plain
        self._at = np.flatnonzero(np.abs(taps[::-1]) > _NOTHING)
        self._weights = taps[::-1][self._at].copy()
        self._middle = len(taps) // 2
        self._held = np.zeros((len(plain), held))

    def missing(self, count: int) -> int:
        """How many more input samples `count` outputs need."""
        return (count - 1) * self._factor + self._taps - self._held.shape[1]

    def advance(self, more: Array, count: int) -> Array:
        """The next `count` outputs, shape (rows, count), once `more` inputs (rows, n) have come."""
        factor, more = self._factor, np.ascontiguousarray(more)
        outputs = -(-count // _OUTPUTS) * _OUTPUTS
        columns = outputs + -(-self._taps // factor)
        places = self._at % factor * columns + self._at // factor
        kept = np.empty((len(more), outputs))
        phases = np.empty((factor, columns))
        _sums(self._held, more, self._weights, places, self._plain, self._middle, phases, kept)
        past = count * factor
        self._held = np.hstack([self._held[:, past:], more[:, max(past - self._held.shape[1], 0) :]])
        return kept[:, :count]


@allocation_free
def _sums(
    held: Array,
    more: Array,
    weights: Array,
    places: NDArray[np.int64],
    plain: NDArray[np.bool_],
    middle: int,
    phases: Array,
    kept: Array,
) -> None:
    """Sums over `held` samples and `more` of them, zeros behind, row by row into `kept` (rows, outputs)."""
    factor = phases.shape[0]
    first, count = held.shape[1], held.shape[1] + more.shape[1]
    for r in range(kept.shape[0]):
        if plain[r]:
            for k in range(kept.shape[1]):
                at = middle + k * factor
                kept[r, k] = 0.0 if at >= count else held[r, at] if at < first else more[r, at - first]
            continue
        if not (_moves(held[r]) or _moves(more[r])):
            kept[r] = 0.0
            continue
        _split(held[r], more[r], phases)
        for k in range(0, kept.shape[1], _OUTPUTS):
            one, two, three, four = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
            for t in range(weights.size):
                weight, at = spread(weights[t]), places[t] + k
                one = fused(weight, load(phases, at), one)
                two = fused(weight, load(phases, at + LANES), two)
                three = fused(weight, load(phases, at + 2 * LANES), three)
                four = fused(weight, load(phases, at + 3 * LANES), four)
            to = r * kept.shape[1] + k
            store(kept, to, one)
            store(kept, to + LANES, two)
            store(kept, to + 2 * LANES, three)
            store(kept, to + 3 * LANES, four)


@allocation_free_inlined
def _moves(row: Array) -> bool:
    at = 0
    while at < row.size and row[at] == 0.0:
        at += 1
    return at < row.size


@allocation_free_inlined
def _split(held: Array, more: Array, phases: Array) -> None:
    """Every phase of the samples by itself, so that neighbours are those of one tap."""
    factor, columns = phases.shape
    first, count = held.size, held.size + more.size
    for p in range(factor):
        old, every = (first - p + factor - 1) // factor, (count - p + factor - 1) // factor
        for column in range(min(old, columns)):
            phases[p, column] = held[column * factor + p]
        for column in range(old, min(every, columns)):
            phases[p, column] = more[column * factor + p - first]
        for column in range(every, columns):
            phases[p, column] = 0.0


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
