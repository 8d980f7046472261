"""Revolutions and speed of a crank from its encoder or its marker."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from daq.angle.cycles import GIVE_UP_S, AngleCycles, Cycles, MarkerCycles
from daq.angle.speed import AngleSpeed, MarkerSpeed

RATE = 5120.0
EVERY = 102
COUNTS = 4096
MARK_TURN = 5 / 360


def turns(seconds: float, rpm: float, start: float = 0.3, gain: float = 0.0) -> np.ndarray:
    """Turns of a crank that starts at `rpm` and gains `gain` rpm a second."""
    times = np.arange(round(seconds * RATE)) / RATE
    return start + (rpm * times + gain * times**2 / 2) / 60.0


def encoder(turned: np.ndarray) -> np.ndarray:
    return np.floor(turned * COUNTS) / COUNTS * 2 * np.pi


def marker(turned: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(2).normal(scale=0.02, size=len(turned))
    return (np.where(turned % 1.0 < MARK_TURN, 5.0, 0.0) + noise).astype(np.float32)


def cut(values: np.ndarray, size: int) -> Iterator[tuple[int, np.ndarray]]:
    for first in range(0, len(values), size):
        yield first, values[first : first + size]


def begins_of(cycles: Cycles, end: int) -> tuple[list[int], list[int], list[bool]]:
    found = cycles.begins.between(0, end)
    return found.offset.tolist(), found.number, found.sound


def test_revolutions_begin_where_the_angle_passes_whole_turns() -> None:
    turned = turns(3.0, 200.0)
    cycles = AngleCycles(RATE)
    cycles.add(0, encoder(turned), True)
    samples, numbers, sound = begins_of(cycles, len(turned))
    assert samples == np.flatnonzero(np.diff(np.floor(turned))).__add__(1).tolist()
    assert numbers == list(range(1, 11))
    assert sound == [False] + [True] * 9
    # half a turn, less the count that the encoder has not shown yet
    assert cycles.turns_at(307) == pytest.approx(turned[307], abs=1 / COUNTS)


def test_revolutions_of_a_marker_begin_at_its_marks() -> None:
    turned = turns(6.0, 150.0)
    cycles = MarkerCycles(RATE)
    for first, values in cut(marker(turned), 500):
        cycles.add(first, values, True)
    samples, numbers, sound = begins_of(cycles, cycles.begins.until)
    expected = np.flatnonzero(np.diff(np.floor(turned))) + 1
    # A mark lies between the two samples that it rises between.
    assert np.abs(np.array(samples) - expected[: len(samples)]).max() <= 1
    assert numbers == list(range(len(samples)))
    assert sound == [False] + [True] * (len(samples) - 1)
    assert cycles.turns_at(samples[3] + 512) == pytest.approx(3 + 512 / RATE * 2.5, abs=1e-3)
    assert np.isnan(cycles.turns_at(samples[0] - 100))


@pytest.mark.parametrize("kind", [AngleCycles, MarkerCycles])
def test_cuts_leave_no_trace(kind: type[AngleCycles] | type[MarkerCycles]) -> None:
    turned = turns(6.0, 120.0, gain=10.0)
    values = encoder(turned) if kind is AngleCycles else marker(turned)
    found = []
    for size in (len(values), 301, 64):
        cycles = kind(RATE)
        for first, block in cut(values, size):
            cycles.add(first, block, True)
        found.append(begins_of(cycles, cycles.begins.until))
    assert found[0] == found[1] == found[2]


def test_a_shaft_that_stops_has_no_revolution_until_it_turns_again() -> None:
    turned = np.concatenate((turns(4.0, 150.0, 0.3), np.full(round(8 * RATE), 10.5), turns(4.0, 150.0, 10.5)))
    cycles = MarkerCycles(RATE)
    for first, values in cut(marker(turned), 512):
        cycles.add(first, values, True)
    samples, _, sound = begins_of(cycles, cycles.begins.until)
    after = [ok for sample, ok in zip(samples, sound, strict=True) if sample > 12 * RATE]
    assert after[0] is False
    assert all(after[1:])
    assert np.isnan(cycles.turns_at(round(8 * RATE)))


def test_channels_do_not_wait_for_a_marker_that_never_comes() -> None:
    cycles = MarkerCycles(RATE)
    cycles.add(0, np.zeros(round(20 * RATE), np.float32), True)
    assert cycles.begins.until == round((20 - GIVE_UP_S) * RATE)


def test_speed_from_an_encoder_is_the_speed_in_the_middle_of_its_samples() -> None:
    turned = turns(4.0, 100.0, gain=50.0)
    speed = AngleSpeed(RATE, EVERY)
    ((first, rpm),) = speed.add(0, turned * 2 * np.pi)
    middles = (np.arange(len(rpm)) * EVERY + (EVERY - 1) / 2) / RATE
    # The slope of a straight line through even samples of a parabola is that in their middle, exactly.
    assert first == 0
    np.testing.assert_allclose(rpm, 100.0 + 50.0 * middles, rtol=1e-9)


def test_steps_of_the_encoder_weigh_little() -> None:
    ((_, rpm),) = AngleSpeed(RATE, EVERY).add(0, encoder(turns(4.0, 200.0)))
    # One count in 20 ms is 0.73 rpm; the end points alone would scatter by 0.3 rpm.
    assert np.std(rpm) < 0.15
    assert np.mean(rpm) == pytest.approx(200.0, abs=0.02)


def test_speed_does_not_depend_on_cuts_and_misses_what_is_missing() -> None:
    angle = encoder(turns(2.0, 200.0))
    ((_, whole),) = AngleSpeed(RATE, EVERY).add(0, angle)
    speed = AngleSpeed(RATE, EVERY)
    runs = [run for first, block in cut(angle, 777) for run in speed.add(first, block)]
    np.testing.assert_array_equal(np.concatenate([values for _, values in runs]), whole)
    gapped = AngleSpeed(RATE, EVERY)
    before, after = gapped.add(0, angle[:1000]), gapped.add(1500, angle[1500:])
    assert [first for first, _ in before + after] == [0, 15]
    np.testing.assert_array_equal(before[0][1], whole[:9])
    np.testing.assert_array_equal(after[0][1], whole[15:])


def test_speed_from_marks_is_that_of_each_revolution() -> None:
    turned = turns(8.0, 150.0)
    cycles = MarkerCycles(RATE)
    speed = MarkerSpeed(cycles, RATE, EVERY)
    rows = []
    for first, values in cut(marker(turned), 1000):
        cycles.add(first, values, True)
        rows += [value for _, part in speed.take(first + len(values)) for value in part]
    known = np.isfinite(rows)
    begins = cycles.begins.between(0, cycles.begins.until).offset
    assert known[: int(begins[0]) // EVERY].sum() == 0
    assert known[int(begins[0]) // EVERY + 1 :].all()
    # A mark is known to 1e-4 of a sample without noise; noise of 0.02 V on a rise of 5 V in a sample: 0.01.
    np.testing.assert_allclose(np.array(rows)[known], 150.0, rtol=2e-2 / (RATE / 2.5) * 10)
