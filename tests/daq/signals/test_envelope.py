import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from daq.signals.envelope import envelope, envelopes

SIGNALS = hnp.arrays(np.float32, st.integers(1, 3000), elements=st.floats(-1e6, 1e6, width=32))


@given(SIGNALS, st.integers(4, 500))
def test_an_envelope_keeps_both_extremes_at_their_own_samples(
    values: np.ndarray, maximum_points: int
) -> None:
    chosen = envelope(values, maximum_points)
    assert chosen.values.min() == values.min()
    assert chosen.values.max() == values.max()
    assert np.array_equal(values[chosen.indices], chosen.values)
    assert np.all(np.diff(chosen.indices) > 0)
    assert len(chosen.indices) <= max(maximum_points, 2)


def test_every_bucket_shows_its_smallest_and_largest_sample() -> None:
    values = np.random.default_rng(0).normal(size=1000)
    chosen = envelope(values, 40)  # buckets of 50 samples
    kept = set(chosen.indices.tolist())
    for start in range(0, 1000, 50):
        bucket = values[start : start + 50]
        assert {start + int(bucket.argmin()), start + int(bucket.argmax())} <= kept


@given(st.integers(1, 300), st.integers(4, 60))
def test_envelopes_are_those_of_each_row(count: int, maximum_points: int) -> None:
    rows = np.random.default_rng(1).normal(size=(3, count))
    for values, together in zip(rows, envelopes(list(rows), maximum_points), strict=True):
        alone = envelope(values, maximum_points)
        assert np.array_equal(together.indices, alone.indices)
        assert np.array_equal(together.values, alone.values)


def test_a_short_array_comes_back_whole() -> None:
    assert np.array_equal(envelope(np.array([3.0, 1.0]), 4).values, [3.0, 1.0])


@pytest.mark.parametrize("position", [0, 123, 999])
def test_a_gap_stays_a_gap(position: int) -> None:
    values = np.zeros(1000)
    values[position] = np.nan
    assert np.isnan(envelope(values, 20).values).any()
