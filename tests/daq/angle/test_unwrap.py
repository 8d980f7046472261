"""Counters come out of their rollovers exactly, or are said to be ambiguous."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from daq.angle.unwrap import Unwrapper, unwrap_counts
from daq.errors import AmbiguousAngle, RattleError, UnphysicalParameter

RANGES = [
    1 << 16,
    1 << 32,
    65_536 * 4096,
    360,
    4096 * 3 + 1,
]  # 16 and 32 bits, multi-turn, even and odd odd ones
Counts = NDArray[np.int64]


@st.composite
def motions(draw: st.DrawFn) -> tuple[int, Counts]:
    """A counter's range and a motion of it, forwards, backwards or still, below half the range a reading."""
    counter_range = draw(st.sampled_from(RANGES))
    most = (counter_range - 1) // 2
    step = st.one_of(st.integers(-most, most), st.integers(-1, 1), st.just(most), st.just(-most))
    steps = draw(st.lists(step, min_size=1, max_size=50))
    start = draw(st.integers(0, counter_range - 1))
    return counter_range, start + np.cumsum(np.array([0, *steps], np.int64))


@given(motions())
@settings(deadline=None)
def test_any_motion_below_half_the_range_is_exact(motion: tuple[int, Counts]) -> None:
    counter_range, truth = motion
    assert np.array_equal(unwrap_counts(truth % counter_range, counter_range), truth)


@given(motions(), st.lists(st.integers(0, 51), max_size=6))
@settings(deadline=None)
def test_cuts_into_blocks_change_nothing(motion: tuple[int, Counts], cuts: list[int]) -> None:
    counter_range, truth = motion
    unwrapper = Unwrapper(counter_range, max(1, counter_range // 5))
    whole = Unwrapper(counter_range, max(1, counter_range // 5)).unwrap(truth % counter_range)
    parts = [unwrapper.unwrap(part) for part in np.split(truth % counter_range, sorted(cuts))]
    assert np.array_equal(np.concatenate([part.counts for part in parts]), whole.counts)
    assert np.array_equal(np.concatenate([part.ambiguous for part in parts]), whole.ambiguous)


def test_a_turn_ends_at_65535_forwards_backwards_and_at_standstill() -> None:
    assert unwrap_counts([65_534, 65_535, 0, 1], 65_536).tolist() == [65_534, 65_535, 65_536, 65_537]
    assert unwrap_counts([1, 0, 65_535, 65_534], 65_536).tolist() == [1, 0, -1, -2]
    assert unwrap_counts([0, 65_535, 0, 0, 65_535], 65_536).tolist() == [0, -1, 0, 0, -1]


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.uint32, np.int64, np.uint64])
def test_the_width_of_the_integers_does_not_matter(dtype: type[np.integer]) -> None:
    assert unwrap_counts(np.array([65_000, 100], dtype), 65_536).tolist() == [65_000, 65_636]


def test_a_signed_counter_rolls_over_at_its_half() -> None:
    assert unwrap_counts(np.array([32_767, -32_768], np.int16), 65_536).tolist() == [32_767, 32_768]


@pytest.mark.parametrize("raw", [[0, 32_768], [32_768, 0]])
def test_half_the_range_may_be_either_way(raw: list[int]) -> None:
    with pytest.raises(
        AmbiguousAngle, match=r"reading 1: -32768 counts of 65536 .* turn slower or read more"
    ):
        unwrap_counts(raw, 65_536)


def test_a_step_that_the_shaft_cannot_make_is_ambiguous() -> None:
    with pytest.raises(AmbiguousAngle, match="reading 2: -25536 counts of 65536") as caught:
        unwrap_counts([0, 5_000, 45_000], 65_536, largest_step=10_000)  # really +40,000
    assert (caught.value.index, caught.value.step, caught.value.counter_range) == (2, -25_536, 65_536)
    assert isinstance(caught.value, RattleError)
    assert isinstance(caught.value, ArithmeticError)


def test_live_an_ambiguous_reading_is_flagged_and_counting_goes_on() -> None:
    unwrapped = Unwrapper(65_536).unwrap([0, 32_768, 32_770])
    assert unwrapped.ambiguous.tolist() == [False, True, False]
    assert unwrapped.counts.tolist() == [0, -32_768, -32_766]


def test_a_reading_that_the_counter_cannot_show_is_ambiguous() -> None:
    assert Unwrapper(65_536).unwrap([5, 70_000, 6]).ambiguous.tolist() == [False, True, False]


@pytest.mark.parametrize(("missing", "ambiguous"), [(0, True), (1, False), (2, False), (3, True)])
def test_over_lost_readings_the_counter_may_have_moved_further(missing: int, ambiguous: bool) -> None:
    unwrapper = Unwrapper(65_536, largest_step=10_000)
    unwrapper.unwrap([0])
    unwrapped = unwrapper.unwrap([15_000], missing_before=missing)  # 4 x 10,000 is beyond half the range
    assert unwrapped.ambiguous.tolist() == [ambiguous]


def test_a_count_goes_far_beyond_32_bits() -> None:
    start = (1 << 40) - 5
    truth = start + 1000 * np.arange(100)
    counts = unwrap_counts(truth % (1 << 32), 1 << 32)
    assert np.array_equal(counts - counts[0], truth - truth[0])


def test_what_cannot_be_unwrapped_is_refused() -> None:
    with pytest.raises(UnphysicalParameter, match="largest step = 32768: 1 to 32767 counts"):
        Unwrapper(65_536, largest_step=32_768)
    with pytest.raises(UnphysicalParameter, match="range = 2: 3 to"):
        Unwrapper(2)
    with pytest.raises(UnphysicalParameter, match="integers"):
        Unwrapper(360).unwrap([0.5, 1.0])
