from math import tau

import numpy as np
import pytest

from daq.angle.speed import SPEED_HZ as SPEEDS_HZ
from rig.live.crank.turning_speed import Speeds, TurningSpeed
from tests.rig.live.crank.turning import COUNTS, RATE, SPEED_HZ, encoder_rad, in_blocks, marker_v, turns


def test_a_speed_that_fluctuates_within_the_turn_is_seen() -> None:
    speed, found = TurningSpeed(by_marker=False), []
    for block in in_blocks("crank.angle", encoder_rad(turns(3.0, fluctuation=0.03))):
        speed.add(block)
        found.append(speed.take())
    times, speeds = (np.concatenate(column) for column in zip(*found, strict=True))
    assert np.diff(times) == pytest.approx(1 / SPEEDS_HZ, abs=1e-12)
    even = 0.25 + SPEED_HZ * times
    exact = tau * SPEED_HZ * (1 + 0.03 * np.cos(tau * even))
    # Half a count either way at its worst is a slope of 1.5 counts in 20 ms; the slope over a fifteenth of a
    # turn swings 0.5 % less.
    assert speeds == pytest.approx(exact, abs=tau * (1.5 / COUNTS * SPEEDS_HZ + 1.5e-4 * SPEED_HZ))


def by_marker(speed: TurningSpeed, first: int) -> Speeds:
    for block in in_blocks("flywheel.marker", marker_v(turns(4.0)), first=first):
        speed.add(block)
    return speed.take()


def test_a_marker_tells_the_speed_of_whole_turns() -> None:
    found = by_marker(TurningSpeed(by_marker=True), 0)
    assert found.speed_rad_s == pytest.approx(tau * SPEED_HZ, rel=2 / 7680)  # a sample at either mark
    assert found.time_s[0] > 0.2  # before the first mark nothing is known


def test_a_view_that_comes_late_and_a_stream_that_begins_anew() -> None:
    speed, late = TurningSpeed(by_marker=True), round(3600 * RATE)
    at_first, later = by_marker(TurningSpeed(by_marker=True), 0), by_marker(speed, late)
    assert later.time_s - 3600.0 == pytest.approx(at_first.time_s, abs=1e-6)
    again = by_marker(speed, 0)
    assert np.array_equal(again.time_s, at_first.time_s)
    assert np.array_equal(again.speed_rad_s, at_first.speed_rad_s)
    assert len(speed.take().time_s) == 0


def test_what_is_no_number_has_no_speed() -> None:
    speed, angle = TurningSpeed(by_marker=False), encoder_rad(turns(1.0))
    angle[5000] = np.nan
    for block in in_blocks("crank.angle", angle):
        speed.add(block)
    assert len(speed.take().time_s) == 49
