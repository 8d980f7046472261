"""The speed of the shaft block by block, from an encoder or from a mark, and what makes it unknown."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channel import Channel
from rig.session.interlock import SpeedGuard
from rig.session.motor import OVERSPEED
from rig.session.shaft_speed import STALE_S, ShaftSpeed, Tachometer
from tests.rig.session.shafts import SteppedClock

RATE, BLOCK = 25_600.0, 2560
COUNT = math.tau / 4096
ANGLE, MARKER, FORCE = Channel("crank.angle", "rad"), Channel("crank.marker", "V"), Channel("pin.force", "N")


def counted(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.floor(angle / COUNT) * COUNT


def marked(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    rng = np.random.default_rng(5)
    return 5.0 * (np.mod(angle, math.tau) < np.deg2rad(5)) + rng.normal(scale=0.02, size=len(angle))


def turned(rpm: float, seconds: float, ripple: float = 0.0) -> NDArray[np.float64]:
    even = rpm * math.tau / 60.0 * np.arange(round(seconds * RATE)) / RATE
    return np.asarray(even + ripple * np.sin(even))


def shown(channel: Channel, values: NDArray[np.float64]) -> tuple[ShaftSpeed, list[float]]:
    """What it says after each block of 0.1 s."""
    clock = SteppedClock()
    speed, said = ShaftSpeed((FORCE, channel), RATE, clock), []
    for first in range(0, len(values), BLOCK):
        clock.sleep(0.1)
        speed.take(first, values[first : first + BLOCK])
        said.append(speed.rpm())
    return speed, said


def test_a_bench_without_angle_and_marker_shows_nothing() -> None:
    speed = ShaftSpeed((FORCE,), RATE, SteppedClock())
    assert speed.channel is None
    assert math.isnan(speed.rpm())


def test_an_angle_is_preferred_to_a_marker() -> None:
    assert ShaftSpeed((MARKER, ANGLE), RATE, SteppedClock()).channel == "crank.angle"


@pytest.mark.parametrize("rpm", [30.0, 65.0, 200.0, 1500.0])
def test_a_steady_speed_by_angle_is_known_to_a_count_in_a_turn(rpm: float) -> None:
    _, said = shown(ANGLE, counted(turned(rpm, 3.0)))
    # A turn's ends are known to a count each, and to a point of 5 ms between which the angle is even.
    assert said[-1] == pytest.approx(rpm, rel=2 / 4096)


@pytest.mark.parametrize("rpm", [10.0, 65.0, 200.0])
def test_ripple_within_a_turn_does_not_show_in_the_mean_of_a_turn(rpm: float) -> None:
    _, said = shown(ANGLE, counted(turned(rpm, max(4.0, 120.0 / rpm), ripple=0.02)))
    # 2 % of ripple; points of 5 ms lie on a chord of it.
    assert said[-10:] == pytest.approx([rpm] * 10, rel=2e-3)


def test_an_angle_that_stops_is_seen_at_once() -> None:
    going = turned(200.0, 2.0)
    values = np.concatenate([going, np.full(BLOCK * 3, going[-1])])
    _, said = shown(ANGLE, counted(values))
    assert abs(said[-1]) < 0.2
    assert abs(said[-2]) < 0.2


@pytest.mark.parametrize("leap", [-1.5, 0.4])
def test_a_counter_that_its_index_sets_shows_no_other_speed(leap: float) -> None:
    angle = counted(turned(25.0, 2.0))
    angle[20_000:] += leap
    _, speeds = shown(ANGLE, angle)
    assert [speed for speed in speeds if not math.isnan(speed)] == pytest.approx(
        [25.0] * len(speeds), abs=1.0
    )


def test_a_shaft_that_turns_backwards_has_a_negative_speed() -> None:
    _, said = shown(ANGLE, counted(-turned(200.0, 2.0)))
    assert said[-1] == pytest.approx(-200.0, rel=1e-3)


@pytest.mark.parametrize("rpm", [65.0, 230.0])
def test_a_marker_gives_the_speed_of_a_turn(rpm: float) -> None:
    _, said = shown(MARKER, marked(turned(rpm, 6.0)))
    assert said[-1] == pytest.approx(rpm, rel=1e-4)


def test_a_glitch_while_the_shaft_comes_up_shows_a_wrong_speed_for_less_than_a_turn() -> None:
    """Which is why a shaft runs away only after a turn: until then nothing tells one glitch from it."""
    rpm, turn_s = 40.0, 1.5
    time_s = np.arange(round(9.0 * RATE)) / RATE
    signal = marked(np.cumsum(np.minimum(time_s, 1.0) * rpm * math.tau / 60.0) / RATE + 1.0)
    longest_s = []
    for at_s in np.arange(2.0, 7.0, 0.12):
        glitched = signal.copy()
        glitched[round(at_s * RATE) :][:77] = 5.0  # 3 ms
        too_fast = np.array(shown(MARKER, glitched)[1]) > OVERSPEED * rpm
        longest_s.append(0.1 * np.count_nonzero(too_fast))
    assert 0.3 < max(longest_s) < turn_s


def test_a_mark_that_is_overdue_leaves_the_speed_unknown_and_valid_until_four_are() -> None:
    going = turned(200.0, 3.0)
    values = np.concatenate([marked(going), np.zeros(BLOCK * 20)])
    speed, said = shown(MARKER, values[: len(going) + BLOCK * 3])
    assert math.isnan(said[-1])
    assert speed.shown.valid
    speed, _ = shown(MARKER, values)
    assert not speed.shown.valid


def test_a_speed_that_no_block_renews_is_unknown() -> None:
    clock = SteppedClock()
    speed = ShaftSpeed((ANGLE,), RATE, clock)
    speed.take(0, turned(200.0, 0.1))
    assert math.isfinite(speed.rpm())
    clock.sleep(STALE_S * 1.01)
    assert math.isnan(speed.rpm())


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_no_speed(odd: float) -> None:
    values = turned(200.0, 0.5)
    values[-10] = odd
    speed, said = shown(ANGLE, values)
    assert math.isnan(said[-1])
    assert not speed.shown.valid


@pytest.mark.parametrize("odd", [5e-324, -5e-324, -0.0])
def test_a_shaft_that_stands_at_hardly_anything_stands(odd: float) -> None:
    _, said = shown(ANGLE, np.full(3 * BLOCK, odd))
    assert said == [0.0] * 3


@pytest.mark.parametrize(
    ("missing", "expected"),
    [(1, []), (3, []), (4, ["speed.abort", "speed.unknown"]), (6, ["speed.abort", "speed.unknown"])],
)
def test_more_than_three_marks_missing_in_a_row_are_an_interlock(missing: int, expected: list[str]) -> None:
    values = marked(turned(230.0, 8.0))
    turn = 60.0 / 230.0 * RATE
    values[round(9.5 * turn) : round((9.5 + missing) * turn)] = 0.0
    clock = SteppedClock()
    speed, guard = ShaftSpeed((MARKER,), RATE, clock), SpeedGuard(clock)
    guard.arm(230.0 * math.tau / 60.0)
    told = []
    for first in range(0, len(values), BLOCK):
        speed.take(first, values[first : first + BLOCK])
        if first >= 2 * RATE:  # it has seen a few marks by then
            told += guard.look(speed.shown, (first + BLOCK) / RATE)
    assert [event.code for event in told] == expected


def test_a_marker_that_is_found_at_another_speed_has_lost_nothing() -> None:
    """Every other mark gone, or one more to each: the speed that it shows is off, and that is judged."""
    turn, values = 60.0 / 230.0 * RATE, marked(turned(230.0, 12.0))
    halved = values.copy()
    for number in range(10, 44, 2):
        halved[round((number - 0.2) * turn) : round((number + 0.2) * turn)] = 0.0
    doubled = np.maximum(
        values, np.where(np.arange(len(values)) > 10 * turn, np.roll(values, round(turn / 2)), 0)
    )
    for odd in (halved, doubled):
        clock = SteppedClock()
        speed = ShaftSpeed((MARKER,), RATE, clock)
        lost, speeds = [], []
        for first in range(0, len(odd), BLOCK):
            speed.take(first, odd[first : first + BLOCK])
            lost.append(speed.shown.lost)
            speeds.append(speed.shown.speed_rad_s * 60.0 / math.tau)
        assert not any(lost)
        assert speeds[-1] in (pytest.approx(115.0, rel=0.01), pytest.approx(460.0, rel=0.01))


def test_no_passage_of_zero_is_made_up_over_values_that_are_not_finite() -> None:
    angle = turned(200.0, 3.0) + 1.0
    hole = slice(8 * BLOCK, 12 * BLOCK)  # 0.4 s, over a turn
    whole, _ = shown(ANGLE, angle)
    with_hole = angle.copy()
    with_hole[hole] = np.nan
    holed, _ = shown(ANGLE, with_hole)
    kept = whole.marks[(whole.marks < hole.start) | (whole.marks > hole.stop)]
    assert holed.marks == pytest.approx(kept, abs=1e-6)


def test_passages_of_zero_are_noted_by_both() -> None:
    angle = turned(200.0, 3.0) + 1.0
    expected = (np.arange(1, 11) * math.tau - 1.0) / (200.0 * math.tau / 60.0) * RATE
    by_angle, _ = shown(ANGLE, angle)
    assert by_angle.marks[:9] == pytest.approx(expected[:9], abs=1e-3)
    by_marker, _ = shown(MARKER, marked(angle))
    assert by_marker.marks[:9] == pytest.approx(expected[:9], abs=1.0)


def test_a_coarse_angle_of_a_slow_shaft_has_the_speed_of_its_turns() -> None:
    # 100 counts a turn, 3.3 of them in a tenth of a second: one more or less is no other speed
    step = math.tau / 100
    channel = Channel("crank.angle", "rad", scale=step, raw_unit="count")
    _, said = shown(channel, np.floor(turned(20.0, 9.0) / step) * step)
    assert said[-40:] == pytest.approx([20.0] * 40, rel=2 / 100)


def test_a_tachometer_shows_the_mean_of_a_block_and_nothing_of_a_shaft_that_stands() -> None:
    clock = SteppedClock()
    tachometer = Tachometer((FORCE, Channel("motor.tachometer", "rad/s")), clock)
    assert tachometer.channel == "motor.tachometer"
    assert math.isnan(tachometer.rpm())
    tachometer.take(np.array([9.0, 11.0]))
    assert tachometer.rpm() == pytest.approx(10.0 * 60.0 / math.tau)
    clock.sleep(STALE_S + 0.01)
    assert math.isnan(tachometer.rpm())
    tachometer.take(np.full(10, 0.1))  # 1 rpm
    assert math.isnan(tachometer.rpm())
    assert Tachometer((FORCE, MARKER), clock).channel is None


def test_a_counters_last_pulses_are_no_speed_of_a_shaft_that_stands() -> None:
    clock = SteppedClock()
    counts = Channel("motor.tachometer", "rad/s", scale=math.tau / 60, raw_unit="Hz")
    tachometer, plain = (Tachometer((each,), clock) for each in (counts, replace(counts, raw_unit="V")))
    speed = 10.0 + 0.001 * np.arange(100)
    late_s, two_pulses_s = 0.0, 2 * math.tau / 60 / speed[-1]
    tachometer.take(speed)
    for _ in range(8):  # its last pulses, in blocks of 0.09 s
        clock.sleep(0.09)
        late_s += 0.09
        for each in (tachometer, plain):
            each.take(np.full(100, speed[-1]))
        assert math.isnan(tachometer.rpm()) == (late_s > STALE_S + two_pulses_s)
        assert plain.rpm() == pytest.approx(speed[-1] * 60 / math.tau)
    tachometer.take(speed)
    assert tachometer.rpm() == pytest.approx(speed.mean() * 60 / math.tau)
