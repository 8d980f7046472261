from math import tau

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.signals.even_angles import EvenAngles, to_even_angles
from daq.signals.orders import order_map
from rig.derived.order_lines import HIGHEST_ORDER, LOWEST_ORDER, POINTS, TURNS, OrderLines, largest_in_bands
from tests.rig.derived.turning import RATE, turns

FAST_HZ = 20.0
"""At 1200 rpm a second has the turns that a spectrum needs."""


def two_channels(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Order 3.5 of 2 units, order 40 of 0.5; the other channel has twice of it."""
    first = 2 * np.cos(tau * 3.5 * way) + 0.5 * np.sin(tau * 40 * way)
    return np.array([first, 2 * first])


def fed(values: NDArray[np.float64], way: NDArray[np.float64], length: int = 2560) -> OrderLines:
    lines = OrderLines()
    for begin in range(0, len(way), length):
        lines.add(values[:, begin : begin + length], way[begin : begin + length])
    return lines


def test_lines_have_their_orders_and_amplitudes_though_the_speed_changes() -> None:
    way = turns(1.2, 0.05, FAST_HZ)
    found = fed(two_channels(way), way).amplitude
    assert found is not None
    for row, factor in zip(found, (1.0, 2.0), strict=True):
        assert row[round(3.5 * TURNS)] == pytest.approx(2.0 * factor, rel=1e-3)  # the resampler's pass band
        assert row[40 * TURNS] == pytest.approx(0.5 * factor, rel=1e-3)
        assert row[20 * TURNS] < 1e-3 * factor


def test_live_and_finished_are_the_same_computation() -> None:
    way = turns(1.5, 0.02, FAST_HZ)
    values = two_channels(way)
    live = fed(values, way, 3333)
    even = to_even_angles(values, way, POINTS)
    offline = order_map(EvenAngles(even.first, even.values[0]), POINTS, TURNS)
    rows = offline.amplitude[-min(len(offline.turn), 8) :]
    assert live.blocks == len(offline.turn)
    assert live.amplitude is not None
    assert live.amplitude[0] == pytest.approx(np.sqrt(np.mean(rows**2, axis=0)), abs=1e-12)


def test_a_hole_ends_a_block_and_a_leap_of_the_angle_begins_a_new_count() -> None:
    way = turns(3.0, speed_hz=FAST_HZ)
    values = two_channels(way)
    values[:, 20_000:20_100] = np.nan
    way[40_000:40_500] = np.nan
    way[60_000:] += 7.3
    found = fed(values, way)
    assert found.amplitude is not None
    assert np.isfinite(found.amplitude).all()
    assert found.amplitude[0, round(3.5 * TURNS)] == pytest.approx(2.0, rel=1e-3)


def test_a_channel_that_was_never_heard_has_no_amplitudes_and_no_bands() -> None:
    way = turns(1.2, speed_hz=FAST_HZ)
    values = two_channels(way)
    values[0] = np.nan
    lines = fed(values, way)
    assert lines.amplitude is not None
    assert np.isnan(lines.amplitude[0]).all()
    assert lines.amplitude[1, round(3.5 * TURNS)] == pytest.approx(4.0, rel=1e-3)
    assert len(largest_in_bands(lines.order, lines.amplitude[0])[0]) == 0  # what the live view draws


def test_a_crank_that_stands_gives_no_orders() -> None:
    still = np.full(int(4 * RATE), 0.3)
    assert fed(np.ones((1, len(still))), still).amplitude is None


def test_without_a_bound_every_block_counts() -> None:
    way = turns(3.0, 0.0, FAST_HZ)
    values = two_channels(way) * np.where(way < 30, 1.0, 0.0)  # loud at first, then still
    newest, every = OrderLines(averaged=2), OrderLines(averaged=None)
    for lines in (newest, every):
        lines.add(values, way)
    assert newest.amplitude is not None
    assert every.amplitude is not None
    at = round(3.5 * TURNS)
    assert newest.amplitude[0, at] < 1e-3
    assert every.amplitude[0, at] > 1.0
    assert every.blocks == newest.blocks


def test_a_peak_keeps_its_order_and_its_size_in_bands() -> None:
    order = np.arange(8 * 410) / 8
    amplitude = np.full(len(order), 0.1)
    amplitude[round(251.375 * 8)] = 7.0
    shown, heights = largest_in_bands(order, amplitude)
    assert len(shown) < 400
    assert shown[np.argmax(heights)] == 251.375
    assert heights.max() == 7.0
    assert shown.min() >= LOWEST_ORDER
    assert shown.max() <= HIGHEST_ORDER


def test_nothing_but_zeros_has_no_bands() -> None:
    shown, heights = largest_in_bands(np.arange(80) / 8, np.zeros(80))
    assert len(shown) == len(heights) == 0
