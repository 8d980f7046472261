"""A driven shaft that leaves its speed, or that nobody sees, ends the run after a stated time."""

from __future__ import annotations

import math

import pytest

from daq.errors import InterlockTripped
from rig.session.shaft_speed import Shown
from rig.session.speed_guard import OFF_S, OFF_SHARE, UNKNOWN_S, SpeedGuard
from tests.rig.session.shafts import SteppedClock

WANTED = 200.0 * math.tau / 60.0
GOOD = Shown(WANTED, valid=True)
UNKNOWN = Shown()
OVERDUE = Shown(math.nan, valid=True)


def codes(guard: SpeedGuard, shown: Shown, from_s: float, seconds: float) -> list[str]:
    """What it tells over blocks of 0.1 s."""
    blocks = round(seconds / 0.1)
    return [event.code for number in range(blocks) for event in guard.look(shown, from_s + 0.1 * number)]


def armed() -> SpeedGuard:
    guard = SpeedGuard(SteppedClock())
    guard.arm(WANTED)
    return guard


@pytest.mark.parametrize("factor", [1 + 1.01 * OFF_SHARE, 1 - 1.01 * OFF_SHARE, 0.0, -1.0])
def test_a_speed_that_leaves_is_told_at_once_and_trips_after_its_time(factor: float) -> None:
    guard, off = armed(), Shown(WANTED * factor, valid=True)
    assert codes(guard, off, 0.0, OFF_S) == ["speed.off"]
    guard.check()
    assert codes(guard, off, OFF_S, 0.1) == ["speed.abort"]
    with pytest.raises(InterlockTripped, match=r"interlock: shaft at .* wanted 200 rpm for 0\.5 s"):
        guard.check()


def test_a_speed_that_nobody_sees_trips_after_its_time() -> None:
    guard = armed()
    assert codes(guard, UNKNOWN, 0.0, UNKNOWN_S) == ["speed.unknown"]
    guard.check()
    assert codes(guard, UNKNOWN, UNKNOWN_S, 0.1) == ["speed.abort"]
    with pytest.raises(InterlockTripped, match=r"no instrument shows the shaft's speed for 1\.0 s"):
        guard.check()


def test_a_speed_that_comes_back_in_time_is_told_again_when_it_leaves_again() -> None:
    guard, off = armed(), Shown(0.9 * WANTED, valid=True)
    told = [codes(guard, each, at, 0.4) for at, each in enumerate((off, GOOD, off, GOOD))]
    assert told == [["speed.off"], [], ["speed.off"], []]
    guard.check()


@pytest.mark.parametrize("shown", [GOOD, OVERDUE, Shown(WANTED * (1 + 0.99 * OFF_SHARE), valid=True)])
def test_what_a_healthy_drive_does_and_one_overdue_mark_are_nothing(shown: Shown) -> None:
    guard = armed()
    assert codes(guard, shown, 0.0, 5.0) == []
    guard.check()


def test_it_only_looks_while_it_is_armed() -> None:
    guard = SpeedGuard(SteppedClock())
    assert codes(guard, UNKNOWN, 0.0, 5.0) == []
    guard.arm(WANTED)
    guard.disarm()
    assert codes(guard, UNKNOWN, 5.0, 5.0) == []
    guard.check()
