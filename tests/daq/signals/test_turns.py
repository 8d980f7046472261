import numpy as np
import pytest

from daq.signals.sine import fit_sine
from daq.signals.turns import angle_turns, drive_turns, mark_times, smooth_turns, turns_at

RATE = 25_600.0


def test_a_drive_is_at_a_whole_turn_where_its_sine_rises_through_zero() -> None:
    values = np.sin(2 * np.pi * 20.0 * np.arange(5000) / RATE + 1.2)
    turns = drive_turns(5000, RATE, 20.0, fit_sine(values, RATE, 20.0).phase)
    # Rounding of the fit, in turns.
    assert np.sin(2 * np.pi * turns) == pytest.approx(values, abs=1e-9)
    assert turns[0] == pytest.approx(1.2 / (2 * np.pi), abs=1e-9)


def test_blocks_of_a_drive_are_parts_of_the_whole() -> None:
    whole = drive_turns(1000, RATE, 19.99, 0.4)
    assert np.array_equal(drive_turns(300, RATE, 19.99, 0.4, first_sample=700), whole[700:])


def test_a_turn_is_a_full_angle() -> None:
    assert angle_turns(np.array([0.0, np.pi, 4 * np.pi])) == pytest.approx([0.0, 0.5, 2.0], rel=1e-15)


def test_marks_of_a_run_up_give_the_turns_between_them() -> None:
    times = np.arange(0.0, 10.0, 1 / 2048)
    marks = np.arange(150)
    mark_s = (np.sqrt(25 + 4 * marks) - 5) / 2  # turns = 5 t + t^2: 300 to 1500 rpm in 10 s
    turns = turns_at(times, mark_s, marks)
    known = np.isfinite(turns)
    assert np.array_equal(known, times <= mark_s[-1])
    # The turns are a parabola in time, which a cubic spline follows but for rounding.
    assert turns[known] == pytest.approx((5 * times + times**2)[known], abs=1e-9)
    straight = np.interp(times, mark_s, marks) - (5 * times + times**2)
    assert np.abs(straight[known]).max() > 5e-3  # what the spline is for


def test_a_single_mark_tells_no_turns() -> None:
    assert np.isnan(turns_at(np.arange(3.0), np.array([1.0]), np.array([0.0]))).all()


def test_a_marker_rises_once_a_turn_whatever_its_ripple() -> None:
    times = np.arange(round(2 * RATE)) / RATE
    turn = 3.3 * times + 0.25
    height = np.clip((turn % 1.0) * 200, 0, 1) * (turn % 1.0 < 5 / 360)  # rises over 1/200 turn
    noise = np.random.default_rng(15).normal(scale=0.02, size=len(times))
    found = mark_times(5 * height + noise, RATE, level=2.5, release=1.0)
    expected = (np.arange(1, 7) + 0.5 / 200 - 0.25) / 3.3
    assert len(found) == 6
    # The flank rises 5 V in 39 samples, so 0.02 V of noise are 0.16 samples; four deviations, 25 us, and as
    # much again for the crossing that noise brings forward.
    assert found == pytest.approx(expected, abs=5e-5)


def test_a_marker_that_never_falls_below_the_release_is_one_mark() -> None:
    values = np.array([0.0, 5.0, 2.0, 5.0, 2.0, 5.0, 0.0, 5.0])
    assert mark_times(values, 1.0, level=2.5, release=1.0) == pytest.approx([0.5, 6.5], rel=1e-15)


def test_smoothing_takes_the_steps_off_a_counting_encoder() -> None:
    time_s = np.arange(20_000) / RATE
    truth = 3.3 * time_s + 0.7 * time_s**2
    counted = (np.floor(truth * 4096) + 0.5) / 4096
    inner = slice(200, -200)
    rough, smooth = ((turns - truth)[inner].std() * 4096 for turns in (counted, smooth_turns(counted, 201)))
    assert rough == pytest.approx(1 / np.sqrt(12), rel=0.02)  # evenly spread over a count
    assert smooth < 0.05
