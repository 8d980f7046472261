"""Position frames have no counter; their timestamps alone must tell what was lost, doubled or overtaken."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.canopen_cia406.order import HOLD, FrameOrder, Placed, PositionFrame

PERIOD_S = 1e-3
EPOCH_S = 1.75e9
DELAY_S = 2e-4


def frame(
    number: int, *, jitter_s: float = 0.0, delay_s: float = DELAY_S, ahead_s: float = 0.0
) -> PositionFrame:
    """Frame `number` of an encoder whose position is 3 counts a frame, by a clock that is `ahead_s`."""
    sent_s = number * PERIOD_S + jitter_s
    return PositionFrame(EPOCH_S + sent_s + ahead_s, 50.0 + sent_s + delay_s, 3 * number % 4096)


def through(order: FrameOrder, frames: list[PositionFrame]) -> list[Placed]:
    placed = [item for one in frames for item in order.put(one)]
    return placed + order.flush()


def true_number(placed: Placed) -> int:
    return round((placed.frame.arrival_s - 50.0 - DELAY_S) / PERIOD_S)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_every_frame_gets_its_own_number_whatever_the_bus_does(seed: int) -> None:
    # Jitter up to a tenth of a period: a frame waits for the longest other one, 0.13 ms at 1 Mbit/s.
    count = 120
    random = np.random.default_rng(seed)
    lost = {n for n in range(1, count - 1) if random.random() < 0.1}
    sent = [frame(n, jitter_s=random.uniform(0, 0.1 * PERIOD_S)) for n in range(count) if n not in lost]
    came: list[PositionFrame] = []
    overtaken: list[PositionFrame] = []
    doubled = 0
    for one in sent:
        chance = random.random()
        if chance < 0.05:
            came += [one, one._replace(timestamp_s=one.timestamp_s + 130e-6)]
            doubled += 1
        elif chance < 0.1 and came and came[-1] not in overtaken and came[-1] in sent:
            overtaken.append(came.pop())
            came += [one, overtaken[-1]]
        else:
            came.append(one)
    order = FrameOrder(PERIOD_S)
    placed = through(order, came)
    assert [item.number for item in placed] == [n for n in range(count) if n not in lost]
    assert [item.frame for item in placed] == sent
    assert (order.missing, order.duplicates, order.reordered) == (len(lost), doubled, len(overtaken))
    assert (order.frames, order.late, order.clock_steps) == (count - len(lost), 0, 0)


def test_a_frame_overtaken_by_too_many_is_late_and_its_slot_stays_missing() -> None:
    order = FrameOrder(PERIOD_S)
    came = [frame(n) for n in range(30) if n != 10]
    came.insert(10 + HOLD + 1, frame(10))
    placed = through(order, came)
    assert [item.number for item in placed] == [n for n in range(30) if n != 10]
    assert (order.late, order.missing, order.reordered) == (1, 1, 0)


@pytest.mark.parametrize("ppm", [-100.0, 0.0, 100.0])
def test_the_period_is_measured_without_touching_a_timestamp(ppm: float) -> None:
    random = np.random.default_rng(3)
    order = FrameOrder(PERIOD_S)
    sent = [
        PositionFrame(
            EPOCH_S + n * PERIOD_S * (1 + ppm * 1e-6) + random.uniform(0, 50e-6), n * PERIOD_S, n % 4096
        )
        for n in range(2000)
    ]
    placed = through(order, sent)
    assert [item.frame for item in placed] == sent
    # Uniform jitter of 50 us has sd 14.4 us; the slope of 2000 points then sd * sqrt(12 / 2000^3) = 0.56 ppm.
    assert order.period_ppm == pytest.approx(ppm, abs=4 * 0.56)


def test_the_period_is_unknown_at_first() -> None:
    order = FrameOrder(PERIOD_S)
    through(order, [frame(n) for n in range(10)])
    assert math.isnan(order.period_ppm)


def test_a_long_loss_is_counted_exactly_although_the_encoder_is_slow() -> None:
    # 300 ppm over 3000 missing frames are 0.9 frames: only the measured period gets it right.
    slow = 1 + 300e-6
    order = FrameOrder(PERIOD_S)
    numbers = [*range(1000), *range(4000, 4100)]
    frames = [PositionFrame(EPOCH_S + n * PERIOD_S * slow, n * PERIOD_S * slow, n % 4096) for n in numbers]
    assert [item.number for item in through(order, frames)] == numbers
    assert order.missing == 3000


@pytest.mark.parametrize("step_s", [3600.0, 0.5, -0.5, -3600.0])
def test_a_clock_that_is_set_loses_nothing_and_is_reported(step_s: float) -> None:
    order = FrameOrder(PERIOD_S)
    came = [frame(n, ahead_s=step_s if n >= 60 else 0.0) for n in range(200)]
    placed = through(order, came)
    assert [item.frame for item in placed] == came
    assert [item.number for item in placed] == list(range(200))
    assert [item.number for item in placed if item.stepped] == [60]
    assert (order.clock_steps, order.missing, order.late) == (1, 0, 0)


def test_a_stall_of_this_machine_is_neither_a_loss_nor_a_step() -> None:
    order = FrameOrder(PERIOD_S)
    came = [
        frame(n, delay_s=DELAY_S if not 50 <= n < 5000 else DELAY_S + (5000 - n) * PERIOD_S)
        for n in range(5200)
    ]
    placed = through(order, came)
    assert [item.number for item in placed] == list(range(5200))
    assert (order.missing, order.clock_steps) == (0, 0)


def test_frames_that_were_stamped_late_and_all_at_once_are_no_loss() -> None:
    """As a USB adapter without a clock of its own does it: five frames wait, and come within 20 us each."""
    order = FrameOrder(PERIOD_S)
    lost, waited = {40, 41, 70}, range(50, 50 + HOLD + 1)
    came = [
        frame(n, jitter_s=(waited[-1] - n) * PERIOD_S + (n - 50) * 20e-6 if n in waited else 0.0)
        for n in range(100)
        if n not in lost
    ]
    assert [item.number for item in through(order, came)] == [n for n in range(100) if n not in lost]
    assert (order.missing, order.reordered, order.late) == (3, 0, 0)


def test_standstill_is_no_duplicate() -> None:
    order = FrameOrder(PERIOD_S)
    placed = through(order, [frame(n)._replace(counts=5) for n in range(100)])
    assert len(placed) == 100
    assert order.duplicates == 0
