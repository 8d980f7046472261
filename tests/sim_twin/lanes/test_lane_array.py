"""Kernels of numbers that are given vectors: what they compute is what numbers give, lane by lane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from numpy.typing import NDArray

from sim_twin.compiled import generic
from sim_twin.contact import ContactLaw, Friction, contact_forces, friction_share
from sim_twin.joints.vectors import sine_cosine
from sim_twin.lane_array import in_lanes, lanes_of, packed, shapes
from sim_twin.vector import LANES, aligned, touches

Array = NDArray[np.float64]
RNG = np.random.default_rng(0)


class Numbers(NamedTuple):
    """Of every kind: a number, a whole one, an array, and those of another."""

    scale: float
    rows: int
    weights: Array
    law: ContactLaw
    friction: Friction


def parameters(number: int) -> Numbers:
    law = ContactLaw(2.0 + number, (1.5, 1.0, 1.2)[number % 3], 0.3, 0.1)
    return Numbers(1.0 + number, 3, RNG.standard_normal((2, 3)), law, Friction(0.4, 0.1, 0.5))


@generic
def kernel(p: Numbers, y: Array, v0: Array, out: Array) -> None:
    total = 0.0
    for row in range(p.rows):
        total += p.weights[1, row] * max(abs(y[row]), 0.5) - min(y[row] / 3.0, -y[row])
    out[0] = p.scale * total
    out[1], out[2] = contact_forces(p.law, y[0], y[1], v0[0])
    out[3] = friction_share(p.friction, y[2])
    out[4], out[5] = sine_cosine(20.0 * y[0])
    out[6] = out[7] = 0.0
    if touches(v0[1]):
        out[6] = out.size * y[1]
    out[7] -= y.shape[0] * y[2]


@njit
def in_eight(table: Array, like: Numbers, y: Array, v0: Array, out: Array) -> None:
    kernel(in_lanes(table, like), lanes_of(y)[0], lanes_of(v0), lanes_of(out))


def test_lanes_of_a_kernel_are_what_it_makes_of_numbers() -> None:
    each = [parameters(number) for number in range(LANES)]
    y, v0, out = aligned((2, 3, LANES)), aligned((2, LANES)), aligned((8, LANES))
    y[:], v0[0] = RNG.standard_normal(y.shape), RNG.uniform(0.0, 1.0, LANES)
    v0[0, 3], v0[1] = 0.0, 1.0
    in_eight(packed(each), each[0], y, v0, out)
    for lane, p in enumerate(each):
        alone = np.zeros(8)
        kernel(p, np.ascontiguousarray(y[0, :, lane]), np.ascontiguousarray(v0[:, lane]), alone)
        np.testing.assert_allclose(out[:, lane], alone, rtol=1e-13, atol=1e-15)
        assert alone[1] == 0.0 or lane != 3  # open
    assert np.count_nonzero(out[1]) >= 2


@generic
def turned(angles: Array, out: Array) -> None:
    for k in range(angles.size):
        out[k, 0], out[k, 1] = sine_cosine(angles[k])


@njit
def turned_in_eight(angles: Array, out: Array) -> None:
    turned(lanes_of(angles), lanes_of(out))


def test_sines_and_cosines_are_within_what_is_promised_up_to_1e5_rad() -> None:
    near, far = np.linspace(-7.0, 7.0, 400), RNG.uniform(-1e5, 1e5, 400)
    angles = np.concatenate([near, far]).reshape(-1, LANES)
    out, alone = aligned((len(angles), 2, LANES)), np.zeros((angles.size, 2))
    turned_in_eight(angles, out)
    turned(angles.ravel(), alone)
    for found in (np.moveaxis(out, 1, 2).reshape(-1, 2), alone):
        np.testing.assert_allclose(found[:, 0], np.sin(angles.ravel()), atol=5e-16, rtol=0.0)
        np.testing.assert_allclose(found[:, 1], np.cos(angles.ravel()), atol=5e-16, rtol=0.0)


def test_what_does_not_fit_an_array_of_vectors_is_refused() -> None:
    @njit
    def too_many(y: Array) -> None:
        lanes_of(y)[0, 0, 0] = 1.0

    with pytest.raises(TypingError, match="item"):
        too_many(aligned((2, 3, LANES))[0])


def test_runs_of_one_kind_have_the_same_shapes() -> None:
    same, other = parameters(1), parameters(2)._replace(weights=np.zeros((3, 2)))
    assert tuple(shapes(parameters(0))) == tuple(shapes(same)) != tuple(shapes(other))
    assert tuple(shapes(same._replace(rows=2))) != tuple(shapes(same))
