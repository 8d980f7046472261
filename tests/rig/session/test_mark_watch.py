"""What a run says of its marker: which marks it saw, how many were missing and how many were none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channel import Channel
from rig.session.shaft_watch import MarkWatch

RATE, BLOCK, RPM = 10_240.0, 1024, 300.0
TURN = RATE * 60.0 / RPM
CHANNELS = (Channel("crank.angle", "rad"), Channel("crank.marker", "V"))


def marker(turns: int) -> NDArray[np.float64]:
    angle = np.arange(round(turns * TURN)) / TURN * math.tau + 1.0
    return np.asarray(5.0 * (np.mod(angle, math.tau) < 0.1))


def watched(values: NDArray[np.float64], recorded_from: int = 0) -> MarkWatch:
    watch = MarkWatch(CHANNELS)
    for first in range(0, len(values), BLOCK):
        watch.take(values[first : first + BLOCK], first >= recorded_from)
    return watch


def without_mark(values: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    begin = round((number - 1.0 / math.tau) * TURN)
    changed = values.copy()
    changed[begin - 50 : begin + 100] = 0.0
    return changed


def test_even_marks_are_no_fault_and_lie_where_the_angle_is_zero() -> None:
    watch = watched(marker(20))
    assert watch.channel == "crank.marker"
    assert watch.fault == ""
    expected = (np.arange(1, 21) - 1.0 / math.tau) * TURN
    assert watch.marks == pytest.approx(expected, abs=1.0)  # a mark begins at a sample


def test_a_missing_mark_and_a_glitch_are_counted() -> None:
    values = without_mark(marker(20), 9)
    glitch = round((14 - 1.0 / math.tau + 0.4) * TURN)
    values[glitch : glitch + 20] = 5.0
    watch = watched(values)
    assert watch.fault == (
        "crank.marker: 1 marks missing in the record, put in evenly; 1 edges rejected as no marks"
    )
    assert not np.any(np.abs(watch.marks - (9 - 1.0 / math.tau) * TURN) < 0.2 * TURN)


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_marks_missing_here_and_there_are_counted_and_the_others_kept(share: float) -> None:
    values, rng = marker(200), np.random.default_rng(17)
    missing = [number for number in range(6, 195) if rng.random() < share]
    for number in missing:
        values = without_mark(values, number)
    watch = watched(values)
    assert watch.fault.startswith(f"crank.marker: {len(missing)} marks missing in the record")
    seen = np.round(watch.marks / TURN + 1.0 / math.tau).astype(int).tolist()
    assert seen == [number for number in range(1, 201) if number not in missing]


def test_doubled_marks_are_rejected_one_by_one() -> None:
    values = marker(40)
    for number in range(10, 31):
        begin = round((number - 1.0 / math.tau + 0.05) * TURN)
        values[begin : begin + 5] = 5.0
    assert watched(values).fault.endswith(
        "0 marks missing in the record, put in evenly; 21 edges rejected as no marks"
    )


def test_samples_of_the_marker_that_are_not_finite_are_no_marks() -> None:
    values = marker(20)
    for number, odd in ((7, np.nan), (11, np.inf), (14, -np.inf)):
        values[round((number + 0.3) * TURN)] = odd
    watch = watched(values)
    assert watch.fault == ""
    assert watch.marks == pytest.approx((np.arange(1, 21) - 1.0 / math.tau) * TURN, abs=1.0)


def test_what_came_before_the_record_is_no_fault_of_it() -> None:
    assert watched(without_mark(marker(20), 9), recorded_from=round(12 * TURN)).fault == ""


def test_a_bench_without_a_marker_has_nothing_to_watch() -> None:
    assert MarkWatch((CHANNELS[0],)).channel is None


def test_without_a_marker_where_an_encoder_stands_is_not_called_the_cranks_zero() -> None:
    skew = "angle - speed x skew = 1.0 rad"
    assert MarkWatch(CHANNELS).standing(skew, "crank.angle") == ("encoder.at_mark", skew)
    code, text = MarkWatch((CHANNELS[0],)).standing(skew, "crank.angle")
    assert code == "encoder.at_angle_zero"
    assert text == f"against the zero of crank.angle, not the crank's mark: {skew}"


@pytest.mark.parametrize("factor", [1.0, 1024 / 1000, 0.5])
def test_an_angle_of_another_number_of_pulses_contradicts_the_marks(factor: float) -> None:
    zeros = np.arange(1, 41) * TURN / factor
    said = watched(marker(20)).contradiction("crank.angle", zeros, 0, round(20 * TURN))
    assert said.startswith(f"crank.angle turns {factor:.4g} times as fast as crank.marker") == (factor != 1.0)
    assert bool(said) == (factor != 1.0)


def test_a_missing_mark_is_no_contradiction_and_too_few_are_none_either() -> None:
    watch, zeros = watched(without_mark(marker(20), 9)), np.arange(1, 21) * TURN
    assert watch.contradiction("crank.angle", zeros, 0, round(20 * TURN)) == ""
    assert watch.contradiction("crank.angle", zeros * 2.0, 0, round(3 * TURN)) == ""
