"""A driven shaft that leaves its speed, or that nobody sees, ends the run after a stated time."""

from __future__ import annotations

import math
import threading

import pytest

from daq.errors import InterlockTripped
from rig.session.interlock import OFF_S, OFF_SHARE, UNKNOWN_S, SpeedGuard
from rig.session.shaft_speed import SpeedReading
from tests.rig.session.shafts import SteppedClock

WANTED = 200.0 * math.tau / 60.0
GOOD = SpeedReading(WANTED, valid=True)
UNKNOWN = SpeedReading()
OVERDUE = SpeedReading(math.nan, valid=True)


def codes(guard: SpeedGuard, shown: SpeedReading, from_s: float, seconds: float) -> list[str]:
    """What it tells over blocks of 0.1 s."""
    blocks = round(seconds / 0.1)
    return [event.code for number in range(blocks) for event in guard.look(shown, from_s + 0.1 * number)]


def armed() -> SpeedGuard:
    guard = SpeedGuard(SteppedClock())
    guard.arm(WANTED)
    return guard


def test_a_stop_does_not_wait_for_who_hangs_while_it_looks_at_the_speed() -> None:
    guard = armed()
    stopping = threading.Thread(target=guard.disarm)
    with guard._lock:
        stopping.start()
        stopping.join(1.0)
        assert not guard.armed
    stopping.join()


@pytest.mark.parametrize("factor", [1 + 1.01 * OFF_SHARE, 1 - 1.01 * OFF_SHARE, 0.0, -1.0])
def test_a_speed_that_leaves_is_told_at_once_and_trips_after_its_time(factor: float) -> None:
    guard, off = armed(), SpeedReading(WANTED * factor, valid=True)
    assert codes(guard, off, 0.0, OFF_S) == ["speed.off"]
    guard.check()
    assert codes(guard, off, OFF_S, 0.1) == ["speed.abort"]
    with pytest.raises(InterlockTripped, match=r"interlock: shaft at .* wanted 200 rpm for 0\.5 s"):
        guard.check()


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(("times", "trips"), [(1.09, False), (1.12, True)])
def test_a_shaft_beyond_what_the_bench_allows_trips_whatever_is_wanted(
    sense: float, times: float, trips: bool
) -> None:
    guard = SpeedGuard(SteppedClock(), highest_rad_s=WANTED)
    beyond = SpeedReading(sense * times * WANTED, valid=True)
    assert codes(guard, beyond, 0.0, 0.5) == ["speed.beyond"] * trips  # 0.3 s and a turn, which takes 0.3 s
    guard.check()
    assert codes(guard, beyond, 0.5, 0.3) == ["speed.abort"] * trips
    if trips:
        with pytest.raises(InterlockTripped, match=r"shaft at .*224 rpm, where the bench allows 200 rpm"):
            guard.check()


def test_a_speed_that_nobody_sees_trips_after_its_time() -> None:
    guard = armed()
    assert codes(guard, UNKNOWN, 0.0, UNKNOWN_S) == ["speed.unknown"]
    guard.check()
    assert codes(guard, UNKNOWN, UNKNOWN_S, 0.1) == ["speed.abort"]
    with pytest.raises(InterlockTripped, match=r"no instrument shows the shaft's speed for 1\.0 s"):
        guard.check()


def test_an_instrument_that_lost_the_shaft_trips_at_once() -> None:
    guard = armed()
    assert codes(guard, SpeedReading(lost="the marker fell off"), 0.0, 0.1) == [
        "speed.abort",
        "speed.unknown",
    ]
    with pytest.raises(InterlockTripped, match="interlock: the marker fell off"):
        guard.check()


def test_a_speed_that_comes_back_in_time_is_told_again_when_it_leaves_again() -> None:
    guard, off = armed(), SpeedReading(0.9 * WANTED, valid=True)
    told = [codes(guard, each, at, 0.4) for at, each in enumerate((off, GOOD, off, GOOD))]
    assert told == [["speed.off"], [], ["speed.off"], []]
    guard.check()


@pytest.mark.parametrize(
    "wrong", [SpeedReading(2.0 * WANTED, valid=True), SpeedReading(0.4 * WANTED, valid=True), UNKNOWN]
)
def test_one_wrong_reading_now_and_then_stops_nothing(wrong: SpeedReading) -> None:
    """A doubled marker pulse, a slip of the count, a block that is no number."""
    guard = armed()
    told = [
        codes(guard, shown, 0.4 * turn + at, 0.1 * blocks)
        for turn in range(50)
        for shown, at, blocks in ((wrong, 0.0, 1), (GOOD, 0.1, 3))
    ]
    assert len([code for each in told for code in each]) == 50
    guard.check()


@pytest.mark.parametrize("factor", [1.5, 2.0, 10.0])
def test_real_overspeed_is_stopped_within_the_stated_time(factor: float) -> None:
    guard, away = armed(), SpeedReading(factor * WANTED, valid=True)
    assert codes(guard, GOOD, 0.0, 1.0) == []
    assert "speed.abort" in codes(guard, away, 1.0, 0.6)
    with pytest.raises(InterlockTripped, match="interlock: "):
        guard.check()


@pytest.mark.parametrize("back", [1.0, 1.045])
def test_a_speed_that_chatters_about_the_limit_is_told_once_and_trips(back: float) -> None:
    guard = armed()
    readings = [
        SpeedReading(WANTED * (1.06 if number % 2 == 0 else back), valid=True) for number in range(10)
    ]
    told = [event.code for number, each in enumerate(readings) for event in guard.look(each, 0.1 * number)]
    assert told == ["speed.off", "speed.abort"]


def test_what_is_seen_for_a_moment_now_and_then_is_not_seen() -> None:
    guard = armed()
    readings = [GOOD if number % 5 == 4 else UNKNOWN for number in range(20)]
    told = [event.code for number, each in enumerate(readings) for event in guard.look(each, 0.1 * number)]
    assert told == ["speed.unknown", "speed.abort"]


@pytest.mark.parametrize("between", [SpeedReading(1.045 * WANTED, valid=True), OVERDUE])
@pytest.mark.parametrize("apart_s", [0.5, 0.6, 300.0])
def test_two_wrong_readings_with_nothing_right_between_stop_nothing(
    between: SpeedReading, apart_s: float
) -> None:
    guard, off = armed(), SpeedReading(1.051 * WANTED, valid=True)
    assert codes(guard, off, 0.0, 0.1) == ["speed.off"]
    assert codes(guard, between, 0.1, apart_s - 0.1) == []
    assert codes(guard, off, apart_s, 0.1) == ["speed.off"]
    guard.check()


def test_readings_that_come_rarely_trip_as_others_do() -> None:
    guard, off = armed(), SpeedReading(0.9 * WANTED, valid=True)
    told = [codes(guard, off, at_s, 0.1) for at_s in (0.0, 0.7)]
    assert told == [["speed.off"], ["speed.abort"]]


def test_an_overdue_mark_neither_ends_nor_trips_what_was_off() -> None:
    guard, off = armed(), SpeedReading(0.9 * WANTED, valid=True)
    assert codes(guard, off, 0.0, 0.2) == ["speed.off"]
    assert codes(guard, OVERDUE, 0.2, 0.3) == []
    assert codes(guard, off, 0.5, 0.1) == ["speed.abort"]


@pytest.mark.parametrize("shown", [GOOD, OVERDUE, SpeedReading(WANTED * (1 + 0.99 * OFF_SHARE), valid=True)])
def test_what_a_healthy_drive_does_and_one_overdue_mark_are_nothing(shown: SpeedReading) -> None:
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
