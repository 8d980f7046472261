"""How late an encoder is against the marker, told apart from its mounting angle by two speeds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.angle.marker import MarkTracker
from daq.angle.skew import AtMark, Skew, angles_at_marks, fastest_rad_s, find_skew
from daq.angle.unwrap import Unwrapper
from daq.time_base.fit import fit_clock
from daq.time_base.model import Anchor

Array = NDArray[np.float64]
RATE = 25_600.0
COUNTS = 65_536
MOUNTED_RAD = 0.8
SAMPLED_S = 1 / RATE / np.sqrt(12)


def recording(
    rpm: float,
    skew_s: float,
    seed: int,
    seconds: float = 10.0,
    rate_ppm: float = 0.0,
    fluctuation: float = 0.0,
) -> AtMark:
    """A CANopen encoder read 1,000 times a second on its own clock, arrivals jittered, beside the card's
    marker."""
    rng = np.random.default_rng([seed, round(rpm)])
    omega = 2 * np.pi * rpm / 60
    start = rng.uniform(0, 2 * np.pi)

    def angle(time_s: Array) -> Array:
        even = start + omega * time_s
        return np.asarray(even + fluctuation * np.sin(even))

    card_s = np.arange(round(seconds * RATE)) / RATE
    marker_v = 5.0 * (np.mod(angle(card_s), 2 * np.pi) < np.deg2rad(5))
    marks, _ = MarkTracker().track(marker_v + rng.normal(scale=0.02, size=len(card_s)))
    true_s = np.arange(0, seconds, 1e-3)
    stamp_s = true_s / (1 + rate_ppm * 1e-6)
    clock = fit_clock(stamp_s, true_s + rng.exponential(1e-3, len(true_s)), Anchor.SHORTEST)
    assert clock is not None
    raw = np.floor((angle(true_s - skew_s) + MOUNTED_RAD) / (2 * np.pi) * COUNTS).astype(np.int64) % COUNTS
    counts = Unwrapper(COUNTS).unwrap(raw).counts.astype(np.float64)
    count_rad = 2 * np.pi / COUNTS
    return angles_at_marks(
        clock.time_s(stamp_s), counts * count_rad, marks.position / RATE, count_rad, SAMPLED_S
    )


def found(*recordings: AtMark) -> Skew:
    skew = find_skew(recordings)
    assert skew is not None
    return skew


@pytest.mark.parametrize("skew_s", [2e-3, -2e-3, 50e-6, 0.0])
def test_two_speeds_tell_the_skew_to_50_us_and_the_mounting_angle(skew_s: float) -> None:
    skew = found(recording(100, skew_s, 1), recording(250, skew_s, 2, rate_ppm=40.0))
    assert skew.skew_s == pytest.approx(skew_s, abs=50e-6)
    assert skew.skew_uncertainty_s is not None
    assert skew.skew_uncertainty_s < 50e-6
    # half a count of 2 pi / 65,536, and 30 us at the mean speed of 18 rad/s
    assert skew.angle_rad == pytest.approx(MOUNTED_RAD, abs=1e-3)


def test_the_stated_uncertainty_holds_the_skew() -> None:
    rng = np.random.default_rng(11)
    held = 0
    for _ in range(200):
        recordings = []
        for speed in (8.0, 20.0, 26.0):
            speeds = speed * rng.uniform(0.99, 1.01, 30)
            shared, scatter = rng.normal(0, 2e-4), rng.normal(0, 5e-4, 30)
            late = 2e-3 + rng.normal(0, 1e-5)
            angles = 0.3 - speeds * late + shared + scatter
            recordings.append(AtMark(np.linspace(0, 10, 30), speeds, angles, 2e-4, 1e-5))
        skew = found(*recordings)
        assert skew.skew_s is not None
        assert skew.skew_uncertainty_s is not None
        held += abs(skew.skew_s - 2e-3) <= skew.skew_uncertainty_s
    assert 180 <= held <= 199  # of 200 at 95 %: 190 +- 3.1


def test_one_speed_only_tells_angle_less_speed_times_skew() -> None:
    skew = found(recording(150, 2e-3, 1), recording(152, 2e-3, 2))
    assert not skew.separable
    assert skew.skew_s is skew.angle_rad is skew.skew_uncertainty_s is None
    omega = 2 * np.pi * 151 / 60
    assert skew.at_mark_rad == pytest.approx(MOUNTED_RAD - 2e-3 * omega, abs=2e-3)
    assert "cannot be told apart" in str(skew)
    assert "second speed" in str(skew)


def test_a_shaft_that_does_not_turn_evenly_does_not_look_late() -> None:
    # 2 % of fluctuation, once a turn, as of an unbalanced crank
    skew = found(*(recording(rpm, 2e-3, 3, fluctuation=0.02) for rpm in (100, 250)))
    assert skew.skew_s == pytest.approx(2e-3, abs=50e-6)


def test_an_angle_near_a_whole_turn_is_not_torn() -> None:
    one, other = (
        AtMark(
            np.arange(5.0), np.full(5, speed), np.mod(np.full(5, -0.01 - speed * 1e-3), 2 * np.pi), 1e-4, 0
        )
        for speed in (5.0, 30.0)
    )
    skew = found(one, other)
    # counts that may be off by 1e-4 rad as a whole take 0.1 us of it
    assert skew.skew_s == pytest.approx(1e-3, abs=1e-7)
    assert skew.angle_rad == pytest.approx(-0.01, abs=1e-6)
    assert str(skew).startswith("encoder late by 1000.0 +- ")


def test_marks_outside_the_encoders_readings_say_nothing() -> None:
    encoder_s = np.arange(100) / 1000.0
    assert len(angles_at_marks(encoder_s, encoder_s, np.array([5.0, 6.0]), 1e-3, 4e-5).angle_rad) == 0
    assert find_skew([angles_at_marks(encoder_s, encoder_s, np.array([]), 1e-3, 4e-5)]) is None


def test_recordings_that_place_the_clock_anew_tell_their_own_skew_once_the_mounting_is_known() -> None:
    rng = np.random.default_rng(5)
    held = np.zeros(4)
    for _ in range(200):
        placed = rng.normal(0, 5e-3, 3)

        def dwells(recording: int, speeds: tuple[float, ...], placed: Array = placed) -> AtMark:
            time_s = np.concatenate([10.0 * at + np.linspace(0, 8, 25) for at in range(len(speeds))])
            speed = np.repeat(speeds, 25) * rng.uniform(0.995, 1.005, len(time_s))
            late = 2e-3 + placed[recording] + 5e-6 * (time_s - time_s.mean())
            angle = 0.8 - speed * late + rng.normal(0, 4e-4, len(speed))
            return AtMark(time_s, speed, angle, 1e-5, 1e-6, placed_s=5e-3)

        skew = found(dwells(0, (10.0, 26.0)), dwells(1, (15.0,)), dwells(2, (26.0,)))
        assert skew.skew_s is not None
        assert skew.skew_uncertainty_s is not None
        held[3] += abs(skew.skew_s - 2e-3) <= skew.skew_uncertainty_s
        assert skew.skew_uncertainty_s > 4e-3  # three recordings, each within 5 ms
        for at, each in enumerate(skew.recordings):
            assert each.skew_s is not None
            assert each.skew_uncertainty_s is not None
            assert each.skew_uncertainty_s < 60e-6
            held[at] += abs(each.skew_s - 2e-3 - placed[at]) <= each.skew_uncertainty_s
    assert np.all((held >= 180) & (held <= 200)), held


def test_marks_that_are_passed_on_a_ramp_are_left_out() -> None:
    speed = np.concatenate([np.full(10, 10.0), np.linspace(11.0, 24.0, 8), np.full(10, 25.0)])
    angle = 0.8 - speed * 2e-3
    angle[10:18] += 0.05
    skew = found(AtMark(np.arange(28.0), speed, angle, 1e-5, 1e-6))
    assert skew.skew_s == pytest.approx(2e-3, abs=1e-6)
    assert skew.recordings[0].speeds_rad_s == pytest.approx((10.0, 25.0))
    assert skew.revolutions == 20


def test_a_shaft_that_turns_too_fast_for_the_encoder_shows_no_mark() -> None:
    highest = fastest_rad_s(1e-3)
    assert highest * 60 / (2 * np.pi) == pytest.approx(1071, abs=1)
    encoder_s = np.arange(0, 2.0, 1e-3)
    for speed, seen in ((0.99 * highest, True), (1.5 * highest, False)):
        marks = np.arange(1, 10) * 2 * np.pi / speed
        assert bool(len(angles_at_marks(encoder_s, speed * encoder_s, marks, 1e-3, 1e-5).angle_rad)) is seen
