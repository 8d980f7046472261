"""The operations on vectors against numpy's, bit for bit."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numba import njit

from sim_twin.vector import (
    LANES,
    aligned,
    first_positive,
    fused,
    fused_less,
    load,
    magnitude,
    pick,
    repeated,
    root,
    signed,
    spread,
    store,
    transpose,
    where_positive,
)

RNG = np.random.default_rng(0)
A, B, C = RNG.standard_normal((3, LANES))


@njit
def results(a: np.ndarray, b: np.ndarray, c: np.ndarray, out: np.ndarray) -> int:
    x, y, z = load(a, 0), load(b, 0), load(c, 0)
    store(out, 0, x + y)
    store(out, 8, x - y)
    store(out, 16, x * y)
    store(out, 24, x / y)
    store(out, 32, fused(x, y, z))
    store(out, 40, fused_less(x, y, z))
    store(out, 48, root(magnitude(x)))
    store(out, 56, signed(x, y))
    store(out, 64, where_positive(x, y, z))
    store(out, 72, spread(2.5) * repeated(a, 3))
    store(out, 80, spread(pick(y, 5)))
    return int(first_positive(x - spread(0.5)))


@njit
def turned(a: np.ndarray) -> None:
    transpose(a, 0)


def test_operations() -> None:
    out = np.zeros((11, LANES))
    first = results(A, B, C, out)
    assert np.array_equal(out[:4], [A + B, A - B, A * B, A / B])
    products = [Fraction(x) * Fraction(y) for x, y in zip(A, B, strict=True)]
    assert np.array_equal(out[4], [float(Fraction(z) + xy) for xy, z in zip(products, C, strict=True)])
    assert np.array_equal(out[5], [float(Fraction(z) - xy) for xy, z in zip(products, C, strict=True)])
    assert np.array_equal(out[6:9], [np.sqrt(np.abs(A)), np.copysign(A, B), np.where(A > 0, B, C)])
    assert np.array_equal(out[9:], [np.full(LANES, 2.5 * A[3]), np.full(LANES, B[5])])
    assert first == np.flatnonzero(A > 0.5)[0]


def test_no_lane_positive() -> None:
    assert results(-np.ones(LANES), B, C, np.zeros((11, LANES))) == LANES


def test_transposition() -> None:
    square = RNG.standard_normal((LANES, LANES))
    copy = square.copy()
    turned(copy)
    assert np.array_equal(copy, square.T)


def test_aligned_arrays_begin_at_a_cache_line() -> None:
    for shape in ((3,), (2, 5, LANES)):
        made = aligned(shape)
        assert made.shape == shape
        assert made.ctypes.data % 64 == 0
        assert not made.any()
