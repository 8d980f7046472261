from math import tau

import numpy as np
import pytest

from rig.live.crank.turning_speed import STEP_S, TurningSpeed
from rig.live.crank.turns import EncoderTurns, MarkerTurns
from tests.rig.live.crank.turning import COUNTS, RATE, SPEED_HZ, encoder_rad, in_blocks, marker_v, turns


def test_a_speed_that_fluctuates_within_the_turn_is_seen() -> None:
    way = turns(3.0, fluctuation=0.03)
    follower, speed = EncoderTurns("crank.angle"), TurningSpeed()
    found = []
    for block in in_blocks("crank.angle", encoder_rad(way)):
        follower.add(block)
        found.append(speed.follow(follower, RATE))
    times, speeds = (np.concatenate([getattr(part, name) for part in found]) for name in found[0]._fields)
    assert np.diff(times) == pytest.approx(STEP_S, abs=1 / RATE)
    even = 0.25 + SPEED_HZ * times
    exact = tau * SPEED_HZ * (1 + 0.03 * np.cos(tau * even))
    # Two smoothed readings, a fifth of a count off each; a mean over a fifteenth of a turn swings 0.7 % less.
    assert speeds[1:] == pytest.approx(exact[1:], abs=tau * (0.4 / COUNTS / STEP_S + 3e-4 * SPEED_HZ))


def test_a_marker_tells_the_speed_of_whole_turns() -> None:
    way = turns(4.0)
    follower = MarkerTurns("flywheel.marker")
    for block in in_blocks(follower.channel, marker_v(way)):
        follower.add(block)
    found = TurningSpeed().follow(follower, RATE)
    assert found.speed_rad_s == pytest.approx(tau * SPEED_HZ, rel=2 / 7680)  # a sample at either mark
    assert found.time_s[0] > 0.2  # before the first mark nothing is known
    assert len(TurningSpeed().follow(follower, RATE, most=10).time_s) == 10
