"""Which frames are missing, by timestamps that come late: exact within limits, beyond them said."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.canopen_cia406.order import FrameOrder, PositionFrame

PERIOD_S, EPOCH_S, COUNT = 1e-3, 1.75e9, 300
NEXT_S = 20e-6
"""What an interface needs from one frame to the next: those that it held up come so close together."""
seeds = st.integers(0, 2**32 - 1)


class Numbered(NamedTuple):
    """What became of frames: how far each number is off, whether it was said to be certain; shape (n,)."""

    off: np.ndarray
    certain: np.ndarray
    missing: int


def numbered(sent: list[int], delays: np.ndarray, stall: tuple[int, float] = (0, 0.0)) -> Numbered:
    """Number the frames `sent`, each late by `delays` periods, and all up to the end of a stall held up.

    `stall`: from which frame on nothing comes, and for how many periods.
    """
    order, came_s, placed = FrameOrder(PERIOD_S), 0.0, []
    for number, delay in zip(sent, delays, strict=True):
        held = stall[0] + stall[1] if number >= stall[0] else 0.0
        came_s = max((number + delay) * PERIOD_S, held * PERIOD_S, came_s + NEXT_S)
        placed += order.put(PositionFrame(EPOCH_S + came_s, 50.0 + came_s, 3 * number % 4096))
    placed += order.flush()
    off = np.array([item.number for item in placed]) - np.array(sent)
    return Numbered(off, np.array([item.certain for item in placed]), order.missing)


def without_bursts(rng: np.random.Generator, share: float, longest: int, first: int = 1) -> list[int]:
    """The frames that are left where bursts of up to `longest` are lost, the last one among them."""
    left, number = list(range(first)), first
    while number < COUNT:
        if rng.random() < share:
            number += int(rng.integers(1, longest + 1))
        left.append(number)
        number += 1
    return left


@settings(max_examples=60, deadline=None)
@given(seeds, st.floats(0.0, 0.49), st.floats(0.0, 0.3))
def test_up_to_half_a_period_late_every_number_is_exact_whatever_is_missing(
    seed: int, jitter: float, share: float
) -> None:
    rng = np.random.default_rng(seed)
    sent = without_bursts(rng, share, longest=20)
    found = numbered(sent, rng.uniform(0.0, jitter, len(sent)))
    assert not found.off.any()
    assert found.missing == sent[-1] + 1 - len(sent)


@settings(max_examples=40, deadline=None)
@given(seeds, st.floats(0.0, 0.4))
def test_what_is_known_for_certain_is_said_to_be(seed: int, jitter: float) -> None:
    rng = np.random.default_rng(seed)
    sent = without_bursts(rng, 0.1, longest=10)
    assert numbered(sent, rng.uniform(0.0, jitter, len(sent))).certain.all()


@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(40, 60), st.floats(0.5, 40.0))
def test_a_stall_is_no_loss_however_many_frames_it_holds_up(seed: int, at: int, length: float) -> None:
    rng = np.random.default_rng(seed)
    sent = [n for n in range(COUNT) if n not in (150, 151, 200)]
    found = numbered(sent, rng.uniform(0.0, 0.2, len(sent)), stall=(at, length))
    assert not found.off.any()
    assert found.certain.all()
    assert found.missing == 3


@settings(max_examples=60, deadline=None)
@given(seeds, st.floats(0.5, 1.0), st.floats(0.01, 0.2))
def test_with_jitter_of_a_period_and_losses_no_number_goes_wrong_in_silence(
    seed: int, jitter: float, share: float
) -> None:
    rng = np.random.default_rng(seed)
    sent = without_bursts(rng, share, longest=3)
    found = numbered(sent, rng.uniform(0.0, jitter, len(sent)))
    said = ~found.certain
    goes_wrong = np.diff(found.off, prepend=0) != 0
    assert (said | np.roll(said, 1))[goes_wrong].all()  # at it or at the frame before


@pytest.mark.parametrize("length", [3.0, 8.0, 30.0])
def test_where_a_frame_is_lost_in_a_stall_nobody_can_know_and_that_is_said(length: float) -> None:
    lost = 100 + int(length) // 2
    sent = [n for n in range(COUNT) if n != lost]
    found = numbered(sent, np.full(len(sent), 0.01), stall=(100, length))
    assert found.missing == 1
    assert not found.off[found.certain].any()
    unsure = np.array(sent)[~found.certain]
    assert unsure.min() == 100
    assert lost < unsure.max() <= 100 + length + 1


def test_what_a_stall_beyond_all_patience_makes_wrong_is_told_and_stays() -> None:
    sent = list(range(COUNT))
    found = numbered(sent, np.full(len(sent), 0.01), stall=(100, 70.0))
    assert (found.off[:100] == 0).all()
    changed = np.flatnonzero(np.diff(found.off, prepend=0))
    assert len(changed)
    assert not found.certain[changed].any()
    assert found.certain[-50:].all()  # by the frame before, that is
    assert found.off[-1] > 0
    assert (found.off[-50:] == found.off[-1]).all()


def test_a_burst_longer_than_all_that_came_before_is_counted_but_not_certain() -> None:
    sent = [*range(30), *range(80, COUNT)]
    found = numbered(sent, np.full(len(sent), 0.01))
    assert not found.off.any()
    assert np.array(sent)[~found.certain].tolist() == [80]
