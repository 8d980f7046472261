"""Before anything moves: every move and what guards it is listed, and what no point may do is refused."""

from __future__ import annotations

import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daq.errors import ConfigurationError
from rig.files.bench import embedded_bench, parse_bench
from rig.files.pairing import bytes_of
from rig.files.sweep import Sweep
from rig.rigs import RIGS
from rig.session.drive import RAMP_S
from rig.session.pace import Paces
from rig.sweep.plan import (
    AROUND_S,
    check_points,
    listing,
    real_instruments,
    seconds_of,
    steps_of,
)
from tests.rig.files.faulty import only_problem, problems_of
from tests.rig.sweep.swept import AXES, SCENARIO, parsed

EMBEDDED_BENCH = RIGS["impact_beam"].bench

TODAY = datetime.date(2026, 9, 1)
GUARDED = f"""{SCENARIO}
[scenario.limits."contact.force_upper"]
warning = "100 N"
abort = "150 N"
hold = "1 ms"
"""


def lines(swept: Sweep, **known: object) -> list[str]:
    return list(listing(swept, embedded_bench(), known, {}, Paces()))  # type: ignore[arg-type]


def test_moves_are_what_changes_from_point_to_point() -> None:
    moves = [[str(move) for move in step.moves] for step in steps_of(parsed(AXES))]
    assert moves == [
        ["model.clearance -> 0.1 mm", "drive.frequency -> 19 Hz"],
        ["drive.frequency 19 Hz -> 20 Hz"],
        ["model.clearance 0.1 mm -> 0.2 mm", "drive.frequency 20 Hz -> 19 Hz"],
        ["drive.frequency 19 Hz -> 20 Hz"],
    ]


def test_the_listing_names_every_move_limit_and_move_by_hand() -> None:
    said = lines(parsed(AXES, scenario=GUARDED))
    assert "4 points, 2 moves by hand" in said[0]
    assert "drive at most 9 of 12 N (signal_generator.maximum_amplitude)" in said[1]
    assert "contact.force_upper: warning 100 N, abort 150 N held for 0.001 s" in said[2]
    assert said[3].startswith("1  BY HAND model.clearance -> 0.1 mm: move the two stops")
    assert said[4] == "2  drive.frequency 19 Hz -> 20 Hz"
    assert said[5].startswith("3  BY HAND model.clearance 0.1 mm -> 0.2 mm")


def test_a_sweep_that_nothing_guards_says_so() -> None:
    assert any("no abort limit on any channel" in line for line in lines(parsed()))


def test_a_position_that_is_set_already_is_not_announced_as_a_move() -> None:
    known = {"model.clearance": "0.1 mm"}
    said = listing(parsed(), embedded_bench(), known, {1: "done"}, Paces())
    first = next(line for line in said if line.startswith("1"))
    assert "BY HAND" not in first
    assert first.endswith("[done]")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ("", "time       about 50 s for 4 points; moves by hand come on top"),
        (
            'until = { impacts = 15, longest = "60 s" }',
            "time       at most 4 min 46 s for 4 points, less where 15 impacts come sooner; moves by hand "
            "come on top",
        ),
    ],
)
def test_a_time_that_impacts_may_shorten_is_told_as_the_most_that_it_takes(settings: str, said: str) -> None:
    assert lines(parsed(settings=settings))[-1] == said


def test_time_and_disk_follow_from_the_points() -> None:
    swept = parsed()
    # 4 points of 1 s settling and 1 s record
    assert seconds_of(swept.points) == pytest.approx(4 * (AROUND_S + 2.0))
    # 5 channels at 51.2 kHz, measured and predicted, 4 bytes and a twentieth
    wanted = [point.scenario.acquisition for point in swept.points]
    assert bytes_of(wanted, embedded_bench()) == pytest.approx(4 * 51_200 * 5 * 2 * 4.2, rel=0.05)
    # a microphone that nobody predicts is written once
    heard = SimpleNamespace(
        channels=[*embedded_bench().daq_card.channels, SimpleNamespace(name="room.noise")]
    )
    bench: Any = SimpleNamespace(daq_card=heard)
    assert bytes_of(wanted, bench) == pytest.approx(4 * 51_200 * (5 * 2 + 1) * 4.2, rel=0.05)


def test_all_faults_of_all_points_at_once() -> None:
    axes = '"drive.amplitude" = ["9 N", "13 N", "14 N"]\n"model.clearance" = ["0.1 mm"]'
    unreachable = GUARDED.replace('abort = "150 N"', 'abort = "300 N"').replace('"100 N"', '"250 N"')
    problems = problems_of(
        lambda: check_points(parsed(axes, scenario=unreachable), embedded_bench(), TODAY, 1e9)
    )
    assert list(problems) == [
        'points 1-3: limits."contact.force_upper".warning',
        'points 1-3: limits."contact.force_upper".abort',
        "point 2: drive.amplitude",
        "point 3: drive.amplitude",
        "free disk space",
    ]
    assert "13 N" in problems["point 2: drive.amplitude"].value
    assert "up to 12 N" in problems["point 2: drive.amplitude"].allowed


def test_a_way_there_and_back_takes_its_time_and_needs_a_soft_start() -> None:
    both_ways = 'up_and_down = ["drive.frequency"]'
    swept = parsed('"drive.frequency" = ["19 Hz", "20 Hz"]', both_ways)
    # 3 points of 1 s settling and 1 s record; 0 + 1 + 2 values come before them
    assert seconds_of(swept.points) == pytest.approx(3 * (AROUND_S + 2.0) + 3 * RAMP_S)
    assert any("through all values before" in line for line in lines(swept))
    check_points(swept, embedded_bench(), TODAY)
    sudden = parsed('"drive.frequency" = ["19 Hz", "20 Hz"]', both_ways, more='[acquisition]\nsettle = "0 s"')
    problem = only_problem(
        lambda: check_points(sudden, embedded_bench(), TODAY), "points 2-3: acquisition.settle"
    )
    assert "at least 0.8 s with up_and_down" in problem.allowed


@pytest.mark.parametrize(
    ("until", "key"),
    [
        ('{ impacts = 9, channels = ["beam.acceleration_50"], above = "3 m/s^2" }', "sweep.until.channels"),
        ('{ impacts = 9, above = "200 N" }', "sweep.until.above"),
    ],
)
def test_impacts_are_counted_on_what_the_bench_measures(until: str, key: str) -> None:
    swept = parsed(settings=f"until = {until}")
    with pytest.raises(ConfigurationError, match=key):
        check_points(swept, embedded_bench(), TODAY)


def test_real_instruments_are_named() -> None:
    text = EMBEDDED_BENCH.replace("emulated = true", 'resource = "TCPIP::10.0.0.5::5025::SOCKET"', 1)
    assert real_instruments(embedded_bench()) == ()
    assert real_instruments(parse_bench(text, "bench.toml", Path())) == ("signal_generator",)
