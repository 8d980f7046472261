import re

import numpy as np
import pytest

from daq.errors import UnphysicalParameter
from daq.signals.even_angles import EvenAngles, to_even_angles
from daq.signals.orders import order_map, order_tracks
from daq.signals.turns import smooth_turns, turns_at

RATE = 2048.0
TIMES = np.arange(round(10 * RATE)) / RATE
SPEED = 5 + 2 * TIMES  # turns a second: 300 to 1500 rpm in 10 s
TURNS = 5 * TIMES + TIMES**2
ORDERS = (1.0, 2.0, 3.5, 6.0)
AMPLITUDES = np.array([2.0, 1.0, 0.5, 0.1])
PHASES = np.array([0.4, -1.3, 2.9, 0.0])
AMPLITUDE_WITHIN = 1e-3  # 0.1 %
PHASE_WITHIN = np.deg2rad(0.1)


def steady() -> np.ndarray:
    lines = AMPLITUDES * np.exp(1j * PHASES)
    return np.real(lines @ np.exp(2j * np.pi * np.outer(ORDERS, TURNS)))


def off(found: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Largest relative error of the amplitude and largest error of the phase."""
    ratio = found / expected
    return float(np.abs(np.abs(ratio) - 1).max()), float(np.abs(np.angle(ratio)).max())


def test_tracked_orders_of_a_run_up_have_their_amplitude_and_phase() -> None:
    found = order_tracks(7.0 + steady(), RATE, TURNS, ORDERS)
    expected = (AMPLITUDES * np.exp(1j * PHASES))[:, None]
    amplitude, phase = off(found.lines, expected)
    # Exact for a steady sum of tracked orders but for rounding, far inside 0.1 % and 0.1 degree.
    assert amplitude < 1e-8
    assert phase < 1e-8
    assert found.amplitude[1] == pytest.approx(1.0, rel=1e-8)
    assert found.phase[1] == pytest.approx(-1.3, abs=1e-8)
    assert len(found.turn) == 36  # of 150 turns, in blocks of 8 that overlap by half


def test_time_and_speed_belong_to_the_middle_of_a_block() -> None:
    found = order_tracks(steady(), RATE, TURNS, ORDERS)
    assert 5 * found.time_s + found.time_s**2 == pytest.approx(found.turn, abs=2e-3)
    assert found.speed_hz == pytest.approx(5 + 2 * found.time_s, rel=1e-3)


def test_an_unbalance_that_grows_with_speed_squared_through_a_resonance() -> None:
    ratio = SPEED / 15.0  # critical speed 900 rpm, 10 % of critical damping
    response = ratio**2 / (1 - ratio**2 + 0.2j * ratio)
    values = np.real(response * np.exp(2j * np.pi * TURNS))
    found = order_tracks(values, RATE, TURNS, [1.0], turns_a_block=4.0)
    there = (5 + 2 * found.time_s) / 15.0
    amplitude, phase = off(found.lines[0], there**2 / (1 - there**2 + 0.2j * there))
    assert amplitude < AMPLITUDE_WITHIN
    assert phase < PHASE_WITHIN


def test_the_turns_may_come_from_marks() -> None:
    marks = np.arange(150)
    turns = turns_at(TIMES, (np.sqrt(25 + 4 * marks) - 5) / 2, marks)
    found = order_tracks(steady(), RATE, turns, ORDERS)
    amplitude, phase = off(found.lines, (AMPLITUDES * np.exp(1j * PHASES))[:, None])
    assert amplitude < AMPLITUDE_WITHIN
    assert phase < PHASE_WITHIN


def test_the_turns_may_come_from_an_encoder_that_counts() -> None:
    counted = (np.floor(TURNS * 4096) + 0.5) / 4096
    found = order_tracks(steady(), RATE, smooth_turns(counted, 41), ORDERS)
    amplitude, phase = off(found.lines, (AMPLITUDES * np.exp(1j * PHASES))[:, None])
    assert amplitude < AMPLITUDE_WITHIN
    assert phase < PHASE_WITHIN


def test_an_order_that_is_not_tracked_leaks_little_into_those_that_are() -> None:
    found = order_tracks(steady() + np.cos(2 * np.pi * 4.5 * TURNS), RATE, TURNS, ORDERS)
    # As strong as order 2 and 8 bins from order 3.5, whose amplitude is half as large.
    assert np.abs(np.abs(found.lines) - AMPLITUDES[:, None]).max() < 2e-3


def test_noise_scatters_a_tracked_order_as_least_squares_must() -> None:
    noise = np.random.default_rng(17).normal(scale=0.1, size=len(TIMES))
    found = order_tracks(noise, RATE, TURNS, [2.0, 4.0, 6.0, 8.0, 10.0, 12.0])
    samples = RATE * 8 / found.speed_hz  # in a block
    scatter = np.mean(np.abs(found.lines) ** 2 * samples) / (4 * 0.1**2)
    # A fit without window and bending has 1; the moments of the Hann window make it 2.90. The lines are some
    # 6 x 36/1.5 exponential numbers: four of their deviations, and the changing speed within a block.
    assert scatter == pytest.approx(2.90, abs=4 * 2.90 / np.sqrt(144))


def test_a_sample_that_does_not_count_takes_its_blocks_with_it() -> None:
    flagged = np.zeros(len(TIMES), dtype=bool)
    flagged[np.searchsorted(TURNS, 70.5)] = True
    found = order_tracks(steady(), RATE, TURNS, ORDERS, flagged=flagged)
    assert found.turn[np.isnan(found.lines).any(axis=0)].tolist() == [68.0, 72.0]


@pytest.mark.parametrize("orders", [[1.0, 1.2], [0.2]])
def test_orders_that_cannot_be_parted_are_refused(orders: list[float]) -> None:
    text = "order tracking: distance of orders = 0.2: at least 4 over the turns of a block, here 0.5"
    with pytest.raises(UnphysicalParameter, match=re.escape(text)):
        order_tracks(steady(), RATE, TURNS, orders)


def test_a_record_shorter_than_a_block_has_no_tracks() -> None:
    short = TURNS < 6
    assert order_tracks(steady()[short], RATE, TURNS[short], ORDERS).lines.shape == (4, 0)


def test_the_map_of_a_run_up_has_amplitude_and_phase_of_each_order() -> None:
    even = to_even_angles(steady(), TURNS, 64)
    found = order_map(even, 64, turns=8)
    lines = [int(np.flatnonzero(found.order == order)[0]) for order in ORDERS]
    amplitude, phase = off(found.lines[:, lines], AMPLITUDES * np.exp(1j * PHASES))
    assert amplitude < AMPLITUDE_WITHIN
    assert phase < PHASE_WITHIN
    assert found.spectrum[lines] == pytest.approx(AMPLITUDES, rel=AMPLITUDE_WITHIN)
    near = [line + step for line in lines for step in (-1, 0, 1)]
    others = np.delete(np.arange(len(found.order)), near)
    assert found.amplitude[:, others].max() < 1e-3


def test_the_mean_and_the_highest_order_of_a_map_count_once() -> None:
    even = EvenAngles(16, 3.0 + 0.5 * (-1.0) ** np.arange(160))
    found = order_map(even, 16, turns=4)
    assert found.lines[:, 0] == pytest.approx(3.0, rel=1e-12)
    assert found.amplitude[:, -1] == pytest.approx(0.5, rel=1e-12)
    assert found.turn.tolist() == [3.0, 5.0, 7.0, 9.0]


def test_blocks_with_a_hole_are_left_out_of_the_spectrum() -> None:
    values = np.cos(2 * np.pi * np.arange(320) / 16)
    values[200] = np.nan
    found = order_map(EvenAngles(0, values), 16, turns=4)
    assert np.isnan(found.lines).any(axis=1).sum() == 2
    assert found.spectrum[4] == pytest.approx(1.0, rel=1e-12)
    hopeless = order_map(EvenAngles(0, np.full(320, np.nan)), 16, turns=4)
    assert np.isnan(hopeless.spectrum).all()
