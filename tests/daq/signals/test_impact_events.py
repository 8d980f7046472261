import pickle
from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from daq.signals.impact_events import (
    BounceGrouper,
    ImpactDetector,
    ImpactEvents,
    impact_events,
)
from daq.signals.impacts import Impacts, Levels, contacts_above, find_impacts, joined, levels_of
from tests.daq.signals.cuts import blocks, cuts_of
from tests.daq.signals.test_impacts import RATE, force

LEVELS = Levels(counts_from_n=5.0, released_below_n=1.0)
SLOW = 100.0  # Hz, for records of few samples
LONGEST_S, WITHIN_S = 0.1, 0.05  # 10 and 5 samples


def equal(parts: Sequence[Impacts | ImpactEvents], whole: Impacts | ImpactEvents) -> bool:
    return all(
        np.array_equal(
            np.concatenate([getattr(part, field.name) for part in parts]), getattr(whole, field.name)
        )
        for field in fields(whole)
    )


@st.composite
def records(draw: st.DrawFn) -> tuple[np.ndarray, list[int]]:
    """Stretches of force that last for some samples, with the places of cuts."""
    height = st.sampled_from([0, 0.5, 3, 8, 40, np.nan])
    heights = draw(hnp.arrays(np.float32, st.integers(0, 60), elements=height))
    values = np.repeat(heights, draw(hnp.arrays(np.intp, len(heights), elements=st.integers(1, 14))))
    uneven = np.random.default_rng(len(values)).uniform(0.9, 1.0, len(values))
    return values * uneven.astype(np.float32), draw(cuts_of(len(values)))


@settings(deadline=None, max_examples=150)
@given(records(), st.sampled_from([0.0, 0.03]))
def test_blocks_of_any_size_give_what_the_whole_gives(
    record: tuple[np.ndarray, list[int]], rings_s: float
) -> None:
    values, cuts = record
    detector, whole_detector = (ImpactDetector(LEVELS, SLOW, WITHIN_S, rings_s, LONGEST_S) for _ in range(2))
    grouper = BounceGrouper(SLOW, WITHIN_S)
    impacts, events = [], []
    for block in blocks(len(values), cuts):
        impacts.append(detector.add(values[block]))
        events.append(grouper.add(impacts[-1], detector.settled))
    impacts.append(detector.finish())
    events += [grouper.add(impacts[-1], detector.settled), grouper.finish()]
    whole = joined([whole_detector.add(values), whole_detector.finish()])
    assert equal(impacts, whole)
    assert equal(events, impact_events(whole, SLOW, WITHIN_S))


def test_the_levels_of_a_run_find_its_impacts() -> None:
    values = force((0.2, 40.0), (0.5, 20.0), (0.7, 3.0))
    expected = find_impacts(values, RATE)
    assert equal([contacts_above(levels_of(float(values.max())), values, RATE)], expected)
    assert len(expected) == 2


def test_a_preload_is_no_impact_and_is_not_remembered() -> None:
    # carried from the first sample on, and rising for ever
    for values, waits in ((np.full(2000, 8.0), 0), (8.0 + 2.0 * np.arange(2000), 11)):
        detector = ImpactDetector(LEVELS, SLOW, WITHIN_S, longest_s=LONGEST_S)
        for first in range(0, 2000, 100):
            assert len(detector.add(values[first : first + 100])) == 0
            assert first + 100 - detector.settled == waits
        assert len(detector.finish()) == 0


def test_blows_on_what_a_joint_carries_are_single_impacts() -> None:
    """Five blows of 30 N, 60 ms apart, on a preload that swings slowly from 40 to 120 N and never ends."""
    times = np.arange(round(0.4 * RATE)) / RATE
    carried = 80.0 - 40.0 * np.cos(2 * np.pi * 2.5 * times)
    blows = [(0.05 + 0.06 * number, 30.0) for number in range(5)]
    values = carried + force(*blows)[: len(times)]
    levels = Levels(counts_from_n=15.0, released_below_n=2.0)
    detector, grouper = ImpactDetector(levels, RATE, 5e-3), BounceGrouper(RATE, 5e-3)
    found = detector.add(values)
    events = [grouper.add(found, detector.settled), grouper.finish()]
    assert began(events) == pytest.approx([at for at, _ in blows], abs=2e-4)
    peaks = np.concatenate([each.peak_n for each in events])
    at_peak = np.interp([at + 5e-4 for at, _ in blows], times, carried) + 30.0
    assert peaks == pytest.approx(at_peak, abs=1.0)


def test_what_rings_is_one_impact_until_it_is_hit_again() -> None:
    times = np.arange(round(0.5 * RATE)) / RATE
    values = sum(
        size * np.where(times >= at, np.exp(-(times - at) / 0.02) * np.sin(1400.0 * (times - at)), 0.0)
        for at, size in ((0.1, 50.0), (0.3, -30.0))
    )
    detector, grouper = ImpactDetector(Levels(5.0, 1.0), RATE, 0.04, rings_s=0.01), BounceGrouper(RATE, 0.04)
    found = detector.add(np.asarray(values))
    assert len(found) == 2  # no half period of the ring is a rise of its own
    events = [grouper.add(found, detector.settled), grouper.finish()]
    assert began(events) == pytest.approx([0.1, 0.3], abs=1e-3)


def began(parts: Sequence[ImpactEvents]) -> np.ndarray:
    """When they begin, in s."""
    return np.concatenate([each.start for each in parts]) / RATE


def test_an_event_is_out_once_no_bounce_can_follow() -> None:
    detector = ImpactDetector(LEVELS, SLOW, WITHIN_S, longest_s=LONGEST_S)
    grouper = BounceGrouper(SLOW, WITHIN_S)
    pulse, pause, more = np.array([0.0, 20.0, 20.0, 0.0]), np.zeros(5), np.full(3, 30.0)
    for block, expected in ((pulse, 0), (pause, 1), (pulse, 0), (more, 0), (pause, 0), (pause, 1)):
        assert len(grouper.add(detector.add(block), detector.settled)) == expected


def test_a_sensor_that_is_never_still_takes_no_more_memory_with_time() -> None:
    values = np.tile([0.0, 20.0, 20.0, 0.0], 5000)
    detector = ImpactDetector(LEVELS, SLOW, WITHIN_S, longest_s=LONGEST_S)
    grouper = BounceGrouper(SLOW, WITHIN_S)
    sizes, events = [], []
    for first in range(0, len(values), 100):
        events.append(grouper.add(detector.add(values[first : first + 100]), detector.settled))
        sizes.append(len(pickle.dumps(grouper)))
    events.append(grouper.finish())
    assert [len(each) for each in events if len(each)] == [1]
    assert events[-1].contacts[0] == 5000
    assert max(sizes[100:]) <= max(sizes[:100]) + 16  # of larger numbers


def test_bounces_belong_to_the_impact_before_them() -> None:
    values = force((0.100, 40.0), (0.104, 50.0), (0.109, 10.0), (0.5, 30.0))
    contacts = find_impacts(values, RATE)
    events = impact_events(contacts, RATE, within_s=0.005)
    assert events.contacts.tolist() == [3, 1]
    assert events.contacts.tolist() == [3, 1]
    # Noise of 0.05 N adds up to three of its deviations to a peak that is flat over some samples.
    assert events.first_n == pytest.approx([40.0, 30.0], abs=0.2)
    assert events.peak_n == pytest.approx([50.0, 30.0], abs=0.2)
    assert events.index / RATE == pytest.approx([0.1045, 0.5005], abs=1e-4)
    # A half sine of peak F and duration T has the impulse 2 F T / pi; 2 % of it lies below the release level.
    assert events.impulse_ns == pytest.approx([2 * 0.1 / np.pi, 2 * 0.03 / np.pi], rel=0.03)
    assert events.contact_s == pytest.approx([3e-3, 1e-3], abs=3e-4)
    assert (events.end - events.start) / RATE == pytest.approx([0.010, 0.001], abs=2e-4)
    assert len(impact_events(contacts, RATE, within_s=0.002)) == 4


def test_without_impacts_there_is_no_event() -> None:
    assert len(impact_events(find_impacts(np.zeros(10), RATE), RATE, 0.01)) == 0
