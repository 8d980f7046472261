"""The measured drive is held to the bench and to the order, whatever the sensor shows beside it."""

from __future__ import annotations

import numpy as np
import pytest

from daq.block import Flag
from daq.channel import Channel
from rig.session.interlock import ForceWatch

RATE, BLOCK, HIGHEST_N = 51_200.0, 5120, 12.0


def shown(
    amplitude: float,
    offset: float = 0.0,
    frequency_hz: float = 20.0,
    noise: float = 0.0,
    driven: bool = True,
) -> tuple[ForceWatch, list[str]]:
    """A second of a drive, and what was told of it."""
    watch = ForceWatch(Channel("drive.force", "N"), frequency_hz, RATE, HIGHEST_N, driven=driven)
    at_s = np.arange(int(RATE)) / RATE
    drive = offset + amplitude * np.sin(2 * np.pi * frequency_hz * at_s + 0.7)
    drive += noise * np.random.default_rng(1).standard_normal(len(at_s))
    told = [watch.take(block) for block in drive.reshape(-1, BLOCK)]
    return watch, list(filter(None, told))


@pytest.mark.parametrize("frequency_hz", [3.0, 7.3, 20.0, 333.0])
@pytest.mark.parametrize(
    ("amplitude", "offset", "within"),
    [
        (13.0, 0.0, True),
        (9.0, 4.0, True),
        (9.0, -4.0, True),
        (13.4, 0.0, False),
        (9.0, 4.4, False),
        (0.0, -13.4, False),
    ],
)
def test_sine_and_mean_together_are_held_to_a_tenth_above_what_the_bench_allows(
    frequency_hz: float, amplitude: float, offset: float, within: bool
) -> None:
    _, told = shown(amplitude, offset, frequency_hz)
    assert (told == []) == within
    if not within:
        assert len(told) == 1  # once, while it lasts
        assert "where the bench allows 12 N" in told[0]


def test_noise_and_bounces_are_no_drive() -> None:
    assert shown(9.0, noise=6.0)[1] == []


@pytest.mark.parametrize("frequency_hz", [30.0, 40.0, 43.0, 50.0, 480.0])
def test_a_force_at_any_other_frequency_is_held_to_the_bench_too(frequency_hz: float) -> None:
    """As a person sets it, an amplifier hums or oscillates: the sine of 20 Hz sees nothing of it."""
    for amplitude, beyond in ((60.0, True), (14.0, True), (12.0, False)):
        watch = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, HIGHEST_N)
        force = amplitude * np.sin(2 * np.pi * frequency_hz * np.arange(int(RATE)) / RATE)
        told = [each for block in force.reshape(-1, BLOCK) if (each := watch.take(block))]
        assert bool(told) == beyond
        if amplitude == 60.0:
            assert "of it not at 20 Hz, where the bench allows 12 N" in told[0]
            assert watch.strength == pytest.approx(60.0, rel=0.02)


def test_two_that_are_allowed_alone_are_not_together() -> None:
    watch, at_s = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, HIGHEST_N), np.arange(int(RATE)) / RATE
    force = 10.0 * np.sin(2 * np.pi * 20.0 * at_s) + 10.0 * np.sin(2 * np.pi * 50.0 * at_s)
    assert any(watch.take(block) for block in force.reshape(-1, BLOCK))


@pytest.mark.parametrize(
    ("amplitude", "told"),
    [(0.0, True), (0.2, True), (0.6, False), (1.1, False), (1.7, False), (2.25, True), (11.0, True)],
)
def test_a_soft_start_goes_on_from_a_third_of_what_is_ordered_up_to_half_as_much_again(
    amplitude: float, told: bool
) -> None:
    assert bool(shown(amplitude, noise=0.02)[0].unlike(1.125, 0.0, 20.0)) == told


def test_hardly_any_force_is_no_danger_however_much_more_or_less_than_ordered() -> None:
    assert shown(0.1)[0].unlike(0.01, 0.0, 20.0) == ""
    assert shown(0.0)[0].unlike(0.3, 0.0, 20.0) == ""


@pytest.mark.parametrize("start_hz", [2.1, 3.0, 10.0, 15.0, 20.0, 23.0, 37.0])
@pytest.mark.parametrize(("amplitude", "told"), [(0.2, True), (1.125, False), (2.25, True)])
def test_a_drive_that_comes_from_another_frequency_is_looked_at_there(
    start_hz: float, amplitude: float, told: bool
) -> None:
    watch = ForceWatch(Channel("drive.force", "N"), 40.0, RATE, HIGHEST_N, slowest_hz=start_hz)
    force = amplitude * np.sin(2 * np.pi * start_hz * np.arange(int(RATE)) / RATE)
    assert not any(watch.take(block) for block in force.reshape(-1, BLOCK))
    assert bool(watch.unlike(1.125, 0.0, start_hz)) == told


@pytest.mark.parametrize(("offset", "told"), [(0.0, False), (2.5, False), (-2.5, False), (5.0, True)])
def test_a_mean_is_held_to_the_offset_that_was_ordered_and_may_be_missing(offset: float, told: bool) -> None:
    assert bool(shown(2.0, offset)[0].unlike(2.0, 2.5, 20.0)) == told


def test_a_healthy_way_up_near_what_the_bench_allows_passes() -> None:
    watch = ForceWatch(Channel("drive.force", "N"), 4.0, RATE, HIGHEST_N, slowest_hz=3.0)
    force = HIGHEST_N * np.sin(2 * np.pi * 3.0 * np.arange(3 * int(RATE)) / RATE + 0.4)
    assert not any(watch.take(block) for block in force.reshape(-1, BLOCK))


def test_a_sensor_that_is_loose_before_anything_moves_harms_nobody() -> None:
    watch = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, HIGHEST_N)
    assert [watch.take(np.full(BLOCK, np.nan)) for _ in range(5)] == [""] * 5


def test_a_push_without_a_sine_is_held_as_well() -> None:
    assert shown(0.0, 8.0)[0].unlike(0.0, 8.0, 20.0) == ""
    assert shown(0.0, 11.0)[0].unlike(0.0, 1.0, 20.0)


def test_where_nothing_is_driven_no_force_is_too_little() -> None:
    assert shown(0.0, driven=False)[0].unlike(1.125, 0.0, 20.0) == ""
    assert shown(11.0, driven=False)[0].unlike(1.125, 0.0, 20.0)


def held(
    ordered: float, amplitude: float, offset: float = 0.0, share: float = 1.0, driven: bool = True
) -> list[int]:
    """In which tenths of 2 s something is told of a drive that is held to an order from 0.35 s on."""
    channel = Channel("drive.force", "N")
    watch = ForceWatch(channel, 20.0, RATE, HIGHEST_N, lambda force: share * force, driven=driven)
    watch.hold(ordered, from_sample=3.5 * BLOCK)
    force = offset + amplitude * np.sin(2 * np.pi * 20.0 * np.arange(2 * int(RATE)) / RATE)
    return [number for number, block in enumerate(force.reshape(-1, BLOCK)) if watch.take(block)]


@pytest.mark.parametrize(
    ("amplitude", "offset", "told"),
    [
        (5.0, 0.0, []),
        (7.0, 0.0, []),
        (8.0, 0.0, [5]),  # once, with the first whole 0.2 s
        (1.0, 0.0, []),
        (0.1, 0.0, [14]),  # after a second
        (5.0, -5.0, []),
    ],
)
def test_a_steady_order_is_held_once_all_that_is_looked_over_came_after_it(
    amplitude: float, offset: float, told: list[int]
) -> None:
    assert held(5.0, amplitude, offset) == told


def test_where_a_gauge_shows_little_of_an_order_impacts_may_make_it_show_all() -> None:
    assert held(2.0, 2.9, share=0.5) == []
    assert held(2.0, 3.3, share=0.5) == [5]
    assert held(2.0, 0.0, share=0.05) == []  # faint, as it was to be


def test_nothing_held_is_too_little_where_nothing_is_driven() -> None:
    assert held(5.0, 0.0, driven=False) == []
    assert held(5.0, 8.0, driven=False) == [5]


def test_another_order_is_held_from_when_it_is_given() -> None:
    watch = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, HIGHEST_N)
    force = np.sin(2 * np.pi * 20.0 * np.arange(int(RATE)) / RATE).reshape(-1, BLOCK)
    watch.hold(2.0, from_sample=0.0)
    assert not any(watch.take(2.0 * block) for block in force)
    watch.let_go()
    assert not any(watch.take(6.0 * block) for block in force)
    watch.hold(6.0, from_sample=20.0 * BLOCK)
    assert not any(watch.take(6.0 * block) for block in force)
    # a person turns the amplifier up
    assert "drive.force = 10.5 N where 6 is ordered" in "".join(watch.take(10.5 * block) for block in force)


def test_a_sensor_that_shows_no_number_does_not_hide_what_comes_after_it() -> None:
    watch = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, HIGHEST_N)
    assert watch.take(np.full(BLOCK, np.nan)) == ""
    high = 20.0 * np.sin(2 * np.pi * 20.0 * np.arange(4 * BLOCK) / RATE)
    assert [bool(watch.take(block)) for block in high.reshape(-1, BLOCK)].count(True) == 1


@pytest.mark.parametrize("flag", [Flag.OVERLOAD, Flag.OPEN_SENSOR, Flag.NOT_FINITE])
def test_a_sensor_that_shows_nothing_as_long_as_it_is_looked_over_cannot_be_relied_on(flag: Flag) -> None:
    watch, zeros = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, HIGHEST_N), np.zeros(BLOCK)
    blocks = [flag, Flag.GOOD, flag, flag, flag, Flag.GOOD, flag, flag]  # 0.1 s each, of 0.2 s
    told = [watch.take(zeros, each) for each in blocks]
    assert [bool(each) for each in told] == [False, False, False, True, False, False, True, False]
    assert "drive.force is overloaded, open or not finite for 0.2 s" in told[3]


@pytest.mark.parametrize("blind", [np.nan, 0.0])
def test_a_sensor_that_is_blind_every_other_moment_hides_no_force(blind: float) -> None:
    watch = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, HIGHEST_N)
    force = 30.0 * np.sin(2 * np.pi * 20.0 * np.arange(10 * BLOCK) / RATE)
    told = []
    for number, block in enumerate(force.reshape(-1, BLOCK)):
        lost = number % 2
        flag = Flag.NOT_FINITE if lost else Flag.GOOD
        told += [watch.take(np.full(BLOCK, blind) if lost else block, flag)]
    assert any(told)


def test_a_slow_sine_that_is_clipped_at_its_peaks_cannot_be_relied_on() -> None:
    """20 N at 0.5 Hz on a range of 9 N: whole blocks about zero are good."""
    watch = ForceWatch(Channel("drive.force", "N"), 0.5, RATE, HIGHEST_N)
    force = 20.0 * np.sin(np.pi * np.arange(8 * int(RATE)) / RATE).reshape(-1, BLOCK)
    clipped = [Flag.OVERLOAD if np.abs(block).max() > 9.0 else Flag.GOOD for block in force]
    told = [watch.take(np.clip(block, -9.0, 9.0), flag) for block, flag in zip(force, clipped, strict=True)]
    assert any("cannot be watched" in each for each in told)


def gauged(amplitude: float, share: float) -> tuple[ForceWatch, list[str]]:
    """A second of 20 Hz, of which a gauge shows so much."""
    channel = Channel("drive.force", "N")
    watch = ForceWatch(channel, 20.0, RATE, HIGHEST_N, lambda force: share * force)
    at_s = np.arange(int(RATE)) / RATE
    blocks = (amplitude * np.sin(2 * np.pi * 20.0 * at_s)).reshape(-1, BLOCK)
    return watch, [told for block in blocks if (told := watch.take(block))]


@pytest.mark.parametrize(
    ("amplitude", "share", "told"), [(7.5, 0.6, False), (8.5, 0.6, True), (14.0, 1.2, False)]
)
def test_a_gauge_is_held_to_what_it_shows_of_what_the_bench_allows(
    amplitude: float, share: float, told: bool
) -> None:
    _, found = gauged(amplitude, share)
    assert len(found) == told
    if told:
        assert found[0].endswith("where the bench allows 12 N, of which it is to show 7.2 N")


@pytest.mark.parametrize(
    ("amplitude", "told"), [(0.3, ""), (0.5, "1.12 is ordered, of which it is to show 0.225 N")]
)
def test_a_gauge_is_held_to_what_it_shows_of_the_order(amplitude: float, told: str) -> None:
    """An amplifier that gives twice as much stays below the order itself."""
    beyond = gauged(amplitude, 0.2)[0].unlike(1.125, 0.0, 20.0)
    assert told in beyond
    assert bool(beyond) == bool(told)
