"""Filters finely sampled signals: what keeps every n-th sample computes only those; recursive filters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import allocation_free, strict
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
        factor, held = self._factor, self._held.shape[1]
        outputs = -(-count // _OUTPUTS) * _OUTPUTS
        columns = outputs + -(-self._taps // factor)
        # every phase of the samples by itself, so that neighbours are those of one tap
        phases = np.zeros((factor, len(more), columns))
        for phase in range(factor):
            own = self._held[:, phase::factor]
            rest = more[:, (phase - held) % factor :: factor][:, : columns - own.shape[1]]
            phases[phase, :, : own.shape[1]] = own
            phases[phase, :, own.shape[1] : own.shape[1] + rest.shape[1]] = rest
        places = self._at % factor * len(more) * columns + self._at // factor
        kept = np.zeros((len(more), outputs))
        _sums(phases, self._weights, places, self._plain, kept)
        middle = phases[self._middle % factor, self._plain]
        kept[self._plain, :count] = middle[:, self._middle // factor :][:, :count]
        past = count * factor
        self._held = np.hstack([self._held[:, past:], more[:, max(past - held, 0) :]])
        return kept[:, :count]


@allocation_free
def _sums(
    phases: Array, weights: Array, places: NDArray[np.int64], plain: NDArray[np.bool_], kept: Array
) -> None:
    columns = phases.shape[2]
    for r in range(kept.shape[0]):
        moves = False
        for p in range(phases.shape[0]):
            for column in range(columns):
                if phases[p, r, column] != 0.0:
                    moves = True
                    break
        if plain[r] or not moves:
            continue
        for k in range(0, kept.shape[1], _OUTPUTS):
            one, two, three, four = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
            for t in range(weights.size):
                weight, at = spread(weights[t]), r * columns + places[t] + k
                one = fused(weight, load(phases, at), one)
                two = fused(weight, load(phases, at + LANES), two)
                three = fused(weight, load(phases, at + 2 * LANES), three)
                four = fused(weight, load(phases, at + 3 * LANES), four)
            to = r * kept.shape[1] + k
            store(kept, to, one)
            store(kept, to + LANES, two)
            store(kept, to + 2 * LANES, three)
            store(kept, to + 3 * LANES, four)


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
