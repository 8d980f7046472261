"""Revolutions from marks: between samples, some missing, doubled or spurious, from standstill on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import signal

from daq.angle.marker import Marks, MarkTracker, RisingEdges, SpeedChange, crank_angle
from daq.errors import UnphysicalParameter

Array = NDArray[np.float64]
RATE = 25_600.0
PULSE = 5 / 360
NOISE_V = 0.02


def marker(turns: Array, seed: int = 1, without: tuple[int, ...] = ()) -> Array:
    """5 V from 0 to 5 degrees in noise, for a shaft at `turns`; the marks of turns `without` are missing."""
    high = (np.mod(turns, 1.0) < PULSE) & ~np.isin(np.floor(turns), without)
    return 5.0 * high + np.random.default_rng(seed).normal(scale=NOISE_V, size=len(turns))


def steady(revolutions: float, samples_per_turn: float = 1000.3, start: float = 0.4) -> Array:
    """Turns of a shaft at a steady speed, one for each sample."""
    return start + np.arange(round(revolutions * samples_per_turn)) / samples_per_turn


def glitched(values_v: Array, *at: int) -> Array:
    values = values_v.copy()
    for each in at:
        values[each : each + 5] = 5.0
    return values


def tracked(values_v: Array) -> tuple[MarkTracker, Marks, list[SpeedChange]]:
    tracker = MarkTracker()
    marks, changes = tracker.track(values_v)
    return tracker, marks, changes


def test_an_ideal_edge_lies_between_its_samples() -> None:
    _, marks, _ = tracked(marker(steady(40)))
    truth = (np.arange(1, len(marks) + 1) - 0.4) * 1000.3
    # between two samples the edge of a rectangle may lie anywhere: half a sample at most, none on average
    assert np.max(np.abs(marks.position - truth)) < 0.51
    assert abs(np.mean(marks.position - truth)) < 4 * 1 / np.sqrt(12 * len(marks))
    assert not marks.interpolated.any()
    assert marks.turn.tolist() == list(range(len(marks)))


def test_a_filtered_edge_is_found_far_finer_than_a_sample() -> None:
    fine = 16
    turns = steady(12, 1000.3 * fine)
    taps = signal.firwin(801, 0.4 / fine * 2)  # the card's anti-alias filter: delays by 400 fine samples
    filtered = np.convolve(5.0 * (np.mod(turns, 1.0) < PULSE), taps)[: len(turns) : fine]
    _, marks, _ = tracked(filtered + np.random.default_rng(2).normal(scale=NOISE_V, size=len(filtered)))
    truth = (np.arange(1, len(marks) + 1) - 0.4) * 1000.3 + 400 / fine
    # the edge rises 4 V a sample: noise is 0.005 samples, the fine grid 0.03, the line's curvature 0.02
    assert np.max(np.abs(marks.position - truth)) < 0.1


def test_noise_at_the_threshold_is_no_second_edge() -> None:
    ramp = np.concatenate([np.zeros(10), np.linspace(0, 5, 400), np.full(50, 5.0), np.linspace(5, 0, 400)])
    noisy = ramp + np.random.default_rng(3).normal(scale=0.1, size=len(ramp))
    assert len(RisingEdges().find(noisy).position) == 1


def test_a_signal_that_begins_on_the_mark_has_no_edge_there() -> None:
    assert RisingEdges().find([5.0, 5.0, 0.0, 0.0, 5.0]).position.tolist() == [3.5]


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite_are_no_edge_and_hide_where_it_was(odd: float) -> None:
    edges = RisingEdges().find([0.0, 0.0, odd, 5.0, 5.0, odd, 5.0])
    assert edges.position.tolist() == [3.0]


def test_no_mark_is_made_of_infinite_samples() -> None:
    values = marker(steady(30))
    clean = tracked(values)[1]
    values[round(14.2 * 1000.3) : round(14.2 * 1000.3) + 20] = np.inf
    tracker, marks, _ = tracked(values)
    assert np.array_equal(marks.position, clean.position)
    assert tracker.extra == 0


def test_thresholds_the_wrong_way_round_are_refused() -> None:
    with pytest.raises(UnphysicalParameter, match=r"lower threshold = 4: below the upper one, 3\.5 V"):
        RisingEdges(low_v=4.0)


@st.composite
def cut_markers(draw: st.DrawFn) -> tuple[Array, list[int]]:
    """Marks dropped and glitches added anywhere, speed changing, and cuts anywhere."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    speed = np.repeat(np.clip(np.cumprod(rng.uniform(0.8, 1.25, 25)), 0.2, 3), 200) / 200
    missing = tuple(np.flatnonzero(rng.random(60) < draw(st.sampled_from([0.0, 0.1, 0.5]))).tolist())
    values = marker(np.cumsum(speed) + rng.random(), seed, missing)
    values = glitched(values, *rng.integers(0, len(values), draw(st.integers(0, 10))).tolist())
    values[rng.random(len(values)) < 0.002] = np.nan
    cuts = draw(st.lists(st.integers(0, len(values)), max_size=12))
    return values, sorted([*cuts, *rng.integers(0, len(values), draw(st.sampled_from([0, 300]))).tolist()])


@given(cut_markers())
@settings(deadline=None, max_examples=40)
def test_cuts_into_blocks_change_nothing_and_turns_only_go_up(case: tuple[Array, list[int]]) -> None:
    values, cuts = case
    whole, marks, changes = tracked(values)
    tracker = MarkTracker()
    parts = [tracker.track(part) for part in np.split(values, cuts)]
    for name in ("position", "turn", "interpolated", "restart"):
        assert np.array_equal(
            np.concatenate([getattr(part, name) for part, _ in parts]), getattr(marks, name)
        )
    assert [change for _, part in parts for change in part] == changes
    assert (tracker.extra, tracker.missing, tracker.lost) == (whole.extra, whole.missing, whole.lost)
    assert tracker.samples_per_turn == whole.samples_per_turn
    assert np.all(np.diff(marks.position) > 0)
    assert marks.turn.tolist() == list(range(len(marks)))


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_missing_marks_are_put_in_and_flagged_and_no_turn_is_lost(share: float) -> None:
    rng = np.random.default_rng(17)
    missing = [turn for turn in range(8, 195) if rng.random() < share]
    tracker, marks, _ = tracked(marker(steady(200), without=tuple(missing)))
    put_in = marks.turn[marks.interpolated] + 1  # the first mark seen begins turn 1 of the shaft
    assert put_in.tolist() == missing
    assert tracker.missing == len(missing)
    assert tracker.extra == tracker.lost == 0
    # even speed, even marks: half a sample at either end
    assert marks.position == pytest.approx((marks.turn + 0.6) * 1000.3, abs=0.6)


@pytest.mark.parametrize("after", [20, 300, 500, 700, 950])
def test_a_glitch_anywhere_in_a_turn_is_rejected_and_counted(after: int) -> None:
    clean = marker(steady(30))
    at = round(20.6 * 1000.3) + after
    tracker, marks, _ = tracked(glitched(clean, at))
    assert np.array_equal(marks.position, tracked(clean)[1].position)
    assert tracker.extra == 1
    assert tracker.missing == tracker.lost == 0


def test_doubled_marks_are_counted_once() -> None:
    clean = marker(steady(30))
    doubles = [round((turn + 0.6) * 1000.3) + 18 for turn in range(6, 28)]
    tracker, marks, _ = tracked(glitched(clean, *doubles))
    assert np.array_equal(marks.position, tracked(clean)[1].position)
    assert tracker.extra == len(doubles)


def test_jittered_marks_are_marks() -> None:
    rng = np.random.default_rng(5)
    values = np.zeros(60_000)
    true = np.arange(1, 59) * 1000 + rng.uniform(-80, 80, 58).astype(int)
    for at in true:
        values[at : at + 14] = 5.0
    tracker, marks, _ = tracked(values)
    assert marks.position == pytest.approx(true - 0.5)
    assert tracker.extra == tracker.missing == 0


@pytest.mark.parametrize(("missing", "valid"), [(1, True), (3, True), (4, False)])
def test_more_than_three_missing_in_a_row_and_the_speed_is_not_valid(missing: int, valid: bool) -> None:
    gone = tuple(range(10, 10 + missing))
    tracker, marks, changes = tracked(marker(steady(20), without=gone))
    assert tracker.samples_per_turn is not None
    assert [change.valid for change in changes] == ([True] if valid else [True, False, True])
    assert tracker.missing == (missing if valid else 0)
    assert marks.restart.tolist().count(True) == (1 if valid else 2)
    if not valid:  # 4.5 turns after the last mark, four have not come
        assert changes[1].position == pytest.approx((9 - 0.4 + 4.5) * 1000.3, abs=6)
        assert np.isnan(crank_angle(marks, [(11 - 0.4) * 1000.3]).angle_rad[0])


def test_a_shaft_that_stops_makes_the_speed_invalid_without_another_mark() -> None:
    turns = np.concatenate([steady(10), np.full(4600, 10.3)])
    tracker, _, changes = tracked(marker(turns))
    assert tracker.samples_per_turn is None
    assert [change.valid for change in changes] == [True, False]


def run_up(turns: float, start: float) -> Array:
    """Turns of a shaft that speeds up evenly from rest at `start`."""
    time = np.arange(0, np.sqrt(turns), 1 / 4000)
    return np.asarray(start + time**2)


@pytest.mark.parametrize("start", [-1e-4, 0.02, 0.3, 0.9])
def test_run_up_from_standstill_does_not_lock_onto_half_the_speed(start: float) -> None:
    # just before the mark, its intervals are 1, 0.41, 0.32, 0.27 ...: the second would be an "extra" edge
    turns = run_up(30, start)
    tracker, marks, _ = tracked(marker(turns))
    assert tracker.samples_per_turn is not None
    assert tracker.extra == tracker.missing == 0
    at_marks = np.interp(marks.position, np.arange(len(turns)), turns)
    # a sample is up to 2 sqrt(30) / 4000 of a turn, and the shaft speeds up within one
    assert np.diff(at_marks) == pytest.approx(np.ones(len(marks) - 1), abs=0.01)


def test_locked_onto_twice_the_speed_by_glitches_it_finds_the_true_one() -> None:
    clean = marker(steady(30))
    halfway = [round((turn + 1.1) * 1000.3) for turn in range(2)]
    tracker, marks, changes = tracked(glitched(clean, *halfway))
    assert tracker.samples_per_turn == pytest.approx(1000.3, abs=1.0)
    assert [change.valid for change in changes] == [True, False, True]
    again = int(np.flatnonzero(marks.restart)[-1])
    assert np.diff(marks.position[again:]) == pytest.approx(np.full(len(marks) - again - 1, 1000.3), abs=1.0)
    assert len(marks) - again > 20


def test_braked_to_rest_the_last_turn_is_taken_for_two_and_flagged() -> None:
    # what an interval test cannot tell: it ends 1, 1.09, ..., 1.30, then 2.41 times the turn before
    turns = 30.0 - run_up(30, 0.0)[::-1] + 1e-3
    tracker, marks, _ = tracked(marker(np.concatenate([turns, np.full(100, turns[-1])])))
    assert tracker.missing == 1
    assert marks.interpolated.tolist().index(True) == len(marks) - 2


@pytest.mark.parametrize(
    "speed",
    [lambda s: 1 + 0.1 * s, lambda s: 1 + 0.3 * np.sin(0.7 * s), lambda s: np.where(s < 12, 1.0, 1.5)],
)
def test_a_speed_that_changes_within_the_bounds_loses_no_turn(speed: Callable[[Array], Array]) -> None:
    turns = np.cumsum(speed(np.arange(30_000) / 1000)) / 1000
    tracker, marks, _ = tracked(marker(turns))
    assert tracker.extra == tracker.missing == tracker.lost == 0
    every = int(np.floor(turns[-1]) - np.floor(turns[0]))
    assert len(marks) in (every, every - 1)  # one that came early may still be held back


def test_the_angle_is_even_between_marks_and_uncertain_beside_a_missing_one() -> None:
    _, marks, _ = tracked(marker(steady(20), without=(10,)))
    samples = np.arange(0, 20_000, 50)
    found = crank_angle(marks, samples)
    truth = 2 * np.pi * (0.4 + samples / 1000.3 - 1)
    seen = np.isfinite(found.angle_rad)
    # half a sample in a thousand a turn
    assert found.angle_rad[seen] == pytest.approx(truth[seen], abs=2 * np.pi * 0.6 / 1000)
    turns = np.floor(0.4 + samples / 1000.3)
    assert not found.certain[(turns == 9) | (turns == 10)].any()
    assert found.certain[(turns > 1) & (turns < 9) | (turns > 11) & (turns < 20)].all()
    assert not seen[0]


def test_without_two_marks_there_is_no_angle() -> None:
    _, marks, changes = tracked(marker(np.full(5000, 0.5)))
    assert changes == []
    assert np.isnan(crank_angle(marks, [0.0, 100.0]).angle_rad).all()
