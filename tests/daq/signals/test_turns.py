import numpy as np
import pytest

from daq.signals.even_angles import angle_turns, smooth_turns, turns_at

RATE = 25_600.0


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


def test_smoothing_takes_the_steps_off_a_counting_encoder() -> None:
    time_s = np.arange(20_000) / RATE
    truth = 3.3 * time_s + 0.7 * time_s**2
    counted = (np.floor(truth * 4096) + 0.5) / 4096
    inner = slice(200, -200)
    rough, smooth = ((turns - truth)[inner].std() * 4096 for turns in (counted, smooth_turns(counted, 201)))
    assert rough == pytest.approx(1 / np.sqrt(12), rel=0.02)  # evenly spread over a count
    assert smooth < 0.05
