"""Filtering with decimation against scipy's, and whatever the blocks are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from sim_twin.decimation import Decimation, decimated

RNG = np.random.default_rng(3)


@pytest.mark.parametrize(("length", "factor"), [(1, 1), (5, 2), (32, 3), (209, 4), (417, 8)])
def test_same_as_filtering_all_and_dropping(length: int, factor: int) -> None:
    taps, fine = RNG.standard_normal(length), RNG.standard_normal(3000)
    expected = np.convolve(fine, taps, "valid")[::factor]
    # Sums of up to 417 products in another order.
    assert decimated(fine, taps, factor, len(expected)) == pytest.approx(expected, abs=1e-12)


def test_same_as_the_polyphase_filter_of_scipy() -> None:
    taps, fine = signal.firwin(209, 0.25), RNG.standard_normal(5000)
    whole = signal.upfirdn(taps, fine, 1, 4)[52:]
    assert decimated(fine, taps, 4, 1000) == pytest.approx(whole[:1000], abs=1e-13)


@pytest.mark.parametrize("block", [1, 7, 100])
def test_blocks_change_no_bit(block: int) -> None:
    taps, fine = RNG.standard_normal(209), RNG.standard_normal(4 * 800 + 209)
    whole = decimated(fine, taps, 4, 800)
    parts = [decimated(fine[4 * k :], taps, 4, min(block, 800 - k)) for k in range(0, 800, block)]
    assert np.array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("part", [1, 7, 40])
def test_parts_of_rows_change_no_bit_and_plain_ones_are_taken_as_they_are(part: int) -> None:
    taps, rows = RNG.standard_normal(21), RNG.standard_normal((3, 1000))
    plain = np.array([False, True, False])
    rows[2] = 0.0
    decimation, found, came = Decimation(taps, 4, plain, held=10), [], 0
    for _ in range(0, 200, part):
        more = decimation.missing(part)
        found.append(decimation.advance(rows[:, came : came + more], part))
        came += more
    of_rows = np.concatenate(found, axis=1)[:, :200]
    padded = np.concatenate([np.zeros(10), rows[0]])
    assert np.array_equal(of_rows[0], decimated(padded, taps, 4, 200))
    assert np.array_equal(of_rows[1], rows[1, :800:4])
    assert not of_rows[2].any()
