"""Sweep files: what their axes come to, and that every fault is told at once."""

from __future__ import annotations

import tomllib
from itertools import pairwise
from pathlib import Path

import pytest

from daq.errors import ConfigurationError
from rig.commands.check import load_any
from rig.files.faults import toml_of
from rig.files.scenario import parse_scenario
from rig.files.sweep import Sweep, load_sweep, parse_sweep, points_named
from tests.rig.files.faulty import only_problem, problems_of

SCENARIOS = Path(__file__).parents[3] / "scenarios"
BASE = """\
[scenario]
rig = "impact_beam"
[scenario.drive]
frequency = "20 Hz"
amplitude = "9 N"
[scenario.acquisition]
sample_rate = "51.2 kHz"
duration = "5 s"
"""


def sweep(axes: str, more: str = "", acquisition: str = "", base: str = BASE) -> Sweep:
    text = f'[sweep]\nname = "tried"\n{more}\n{base}\n[axes]\n{axes}\n[acquisition]\n{acquisition}\n'
    return parse_sweep(text, "sweep.toml", SCENARIOS)


def values(swept: Sweep, key: str) -> list[object]:
    return [point.settings[key] for point in swept.points]


@pytest.mark.parametrize(
    "name", ["beam_frequency.sweep.toml", "beam_frequency_27.sweep.toml", "crank_speed.sweep.toml"]
)
def test_the_examples_are_sound(name: str) -> None:
    assert isinstance(load_any(SCENARIOS / name), Sweep)
    swept = load_sweep(SCENARIOS / name)
    for point in swept.points:
        assert parse_scenario(point.scenario.text) == point.scenario


def test_the_sweep_of_figure_10_has_27_frequencies_one_clearance_and_15_impacts() -> None:
    swept = load_sweep(SCENARIOS / "beam_frequency_27.sweep.toml")
    hertz = [point.scenario.drive.frequency for point in swept.points]
    assert (len(hertz), hertz[0], hertz[-1], hertz == sorted(hertz)) == (27, 19.5, 21.0, True)
    assert [point.scenario.model["clearance"] for point in swept.points] == pytest.approx([0.127e-3] * 27)
    assert not any(axis.by_hand or axis.both_ways for axis in swept.axes)
    assert swept.until is not None
    assert (swept.until.impacts, swept.until.longest) == (15, 5.0)
    assert swept.until.longest > swept.until.impacts / (2 * hertz[0])  # two half cycles, one impact each


def test_other_values_of_its_scenario_stand_in_every_point_and_leave_the_sweep_as_it_is() -> None:
    file = SCENARIOS / "beam_frequency.sweep.toml"
    plain, noted = load_sweep(file), load_sweep(file, {"notes.operator": "Ada"})
    assert {point.scenario.notes["operator"] for point in noted.points} == {"Ada"}
    assert [parse_scenario(point.scenario.text) for point in noted.points] == [
        point.scenario for point in noted.points
    ]
    assert (noted.text, noted.base) == (plain.text, plain.base)  # so it goes on where it was without them


def test_the_last_axis_changes_at_every_point_and_order_says_which_is_last() -> None:
    axes = '"drive.frequency" = ["19 Hz", "20 Hz"]\n"drive.amplitude" = ["6 N", "9 N"]'
    inner = sweep(axes)
    assert values(inner, "drive.frequency") == ["19 Hz", "19 Hz", "20 Hz", "20 Hz"]
    outer = sweep(axes, 'order = ["drive.amplitude", "drive.frequency"]')
    assert values(outer, "drive.frequency") == ["19 Hz", "20 Hz"] * 2
    assert [point.scenario.drive.amplitude for point in outer.points] == [6.0, 6.0, 9.0, 9.0]


def test_up_and_down_turns_at_the_last_value_once() -> None:
    swept = sweep('"drive.frequency" = ["19 Hz", "20 Hz", "21 Hz"]', 'up_and_down = ["drive.frequency"]')
    assert values(swept, "drive.frequency") == ["19 Hz", "20 Hz", "21 Hz", "20 Hz", "19 Hz"]


def test_the_drive_comes_to_a_point_through_the_values_before_it_on_an_axis_that_goes_there_and_back() -> (
    None
):
    axes = '"drive.frequency" = ["19 Hz", "20 Hz"]\n"drive.amplitude" = ["6 N", "9 N"]'
    swept = sweep(axes, 'up_and_down = ["drive.frequency"]')
    ways = [[(d.frequency, d.amplitude) for d in point.path] for point in swept.points]
    assert ways == [
        [],
        [],
        [(19.0, 6.0)],
        [(19.0, 9.0)],
        [(19.0, 6.0), (20.0, 6.0)],
        [(19.0, 9.0), (20.0, 9.0)],
    ]
    assert not any(point.path for point in sweep(axes).points)
    by_hand = sweep("\"model.clearance\" = ['1 mm', '2 mm']", 'up_and_down = ["model.clearance"]')
    assert not any(point.path for point in by_hand.points)


def test_a_linear_range_is_even_and_holds_both_ends_in_the_operators_unit() -> None:
    swept = sweep('"drive.frequency" = { from = "19.5 Hz", to = "21 Hz", steps = 27 }')
    assert values(swept, "drive.frequency")[:2] == ["19.5 Hz", "19.5576923 Hz"]
    hertz = [point.scenario.drive.frequency for point in swept.points]
    assert (len(hertz), hertz[0], hertz[-1]) == (27, 19.5, 21.0)
    steps = [b - a for a, b in pairwise(hertz)]
    # nine digits are kept: 1e-8 of 20 Hz, against the 2e-4 that a frequency is held to
    assert max(steps) - min(steps) < 1e-6


def test_a_log_range_has_even_ratios_even_between_two_units() -> None:
    swept = sweep('"drive.amplitude" = { from = "900 mN", to = "9 N", steps = 3, spacing = "log" }')
    newtons = [point.scenario.drive.amplitude for point in swept.points]
    assert newtons == pytest.approx([0.9, 0.9 * 10**0.5, 9.0], rel=1e-8)


def test_a_falling_range_and_keys_without_quotes() -> None:
    swept = sweep("drive.frequency = { from = 21, to = 20, steps = 2 }\nmodel.clearance = ['0.2 mm']")
    assert values(swept, "drive.frequency") == [21.0, 20.0]
    assert [axis.key for axis in swept.axes if axis.by_hand] == ["model.clearance"]


def test_cycles_give_each_point_its_own_duration() -> None:
    swept = sweep('"drive.frequency" = ["5 Hz", "20 Hz"]', acquisition="cycles = 100\nsettle = 2")
    assert [point.scenario.acquisition.duration for point in swept.points] == [20.0, 5.0]
    assert {point.scenario.acquisition.settle for point in swept.points} == {2.0}


def test_until_ends_at_impacts_on_the_rigs_contact_forces_and_at_the_longest() -> None:
    swept = sweep('"drive.amplitude" = [9]', 'until = { impacts = 15, longest = "60 s" }')
    assert swept.until is not None
    assert swept.until.channels == ("contact.force_upper", "contact.force_lower")
    assert (swept.until.impacts, swept.until.longest, swept.until.above) == (15, 60.0, None)
    assert swept.points[0].scenario.acquisition.duration == 60.0


def test_without_a_longest_the_scenarios_duration_is_it() -> None:
    swept = sweep('"drive.amplitude" = [9]', "until = { impacts = 15 }")
    assert swept.until is not None
    assert swept.until.longest == 5.0


@pytest.mark.parametrize(
    ("axes", "more", "key", "allowed"),
    [
        ('"drive.freqency" = [20]', "", 'axes."drive.freqency"', 'did you mean axes."drive.frequency"'),
        ('"model.modal_damping" = [0.01]', "", 'axes."model.modal_damping"', "unknown key"),
        ('"drive.frequency" = ["20 N"]', "", 'axes."drive.frequency"[0]', "not a unit of this kind"),
        ('"drive.frequency" = []', "", 'axes."drive.frequency"', "1 to 1000 values"),
        ('"drive.frequency" = ["20 Hz", "20 Hz"]', "", 'axes."drive.frequency"', "no two neighbours"),
        ('"drive.frequency" = { from = 19, to = 21 }', "", 'axes."drive.frequency".steps', "2 to 1000"),
        ('"drive.frequency" = { to = 21, steps = 3 }', "", 'axes."drive.frequency".from', "a quantity"),
        (
            '"drive.offset" = { from = -1, to = 1, steps = 3, spacing = "log" }',
            "",
            'axes."drive.offset".spacing',
            "a range that holds 0",
        ),
        ('"drive.frequency" = [20]', 'order = ["drive.amplitude"]', "sweep.order", "drive.frequency"),
        ('"drive.frequency" = [20]', 'up_and_down = ["model.clearance"]', "sweep.up_and_down", "keys of"),
        ('"drive.frequency" = [20]', "until = { longest = 3 }", "sweep.until.impacts", "whole number"),
        (
            '"drive.frequency" = [20]',
            'until = { impacts = 3, channels = ["crank.angle"] }',
            "sweep.until.channels",
            "channels of the impact_beam",
        ),
        (
            '"model.beam" = { from = "steel", to = "steel", steps = 2 }',
            "",
            'axes."model.beam"',
            "a list of values",
        ),
        ('"drive.offset" = ["0.1 N"]', "centre = true", "sweep.centre", "which centring sets"),
        ('"drive.frequency" = [20]', "colour = 3", "sweep.colour", "unknown key"),
    ],
)
def test_a_fault_is_told_with_its_key(axes: str, more: str, key: str, allowed: str) -> None:
    assert allowed in only_problem(lambda: sweep(axes, more), key).allowed


def test_faults_of_points_are_told_once_with_the_points_that_have_them() -> None:
    slow = BASE.replace('"20 Hz"', '"0.01 Hz"')
    assert list(problems_of(lambda: sweep('"drive.amplitude" = [8, 9]', base=slow))) == [
        "points 1-2: drive.frequency"
    ]
    offset = BASE.replace("[scenario.acq", 'offset = "9 N"\n[scenario.acq')
    problems = problems_of(lambda: sweep('"drive.amplitude" = [9, 95, 9, 95]', base=offset))
    assert list(problems) == ["points 2, 4: drive.offset"]


def test_every_fault_of_the_file_is_told_at_once() -> None:
    problems = problems_of(
        lambda: sweep('"drive.frequency" = ["x"]\n"drive.tone" = [1]', "centre = 3", "settle = -1")
    )
    assert set(problems) == {
        'axes."drive.frequency"[0]',
        'axes."drive.tone"',
        "sweep.centre",
        "acquisition.settle",
    }


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('[sweep]\nname = "x"\n[axes]\n', "a path behind sweep.scenario or tables"),
        ('[sweep]\nname = "x"\nscenario = "nowhere.toml"\n[axes]\n', "a readable file"),
        ('[sweep]\nname = "x"\nscenario = 3\n[axes]\n', "the path of a scenario"),
        ("sweep = 3\n[scenario]\nrig = 'impact_beam'\n[axes]\n", r"a table \[sweep\]"),
        ("[sweep]\n[scenario]\nrig = 3\n[axes]\n", "impact_beam or planar"),
        (
            "[sweep]\nname='x'\n[scenario]\nrig='impact_beam'\ndrive=3\n[axes]\n'drive.frequency'=[20]",
            "drive",
        ),
        ("[axes]\n[scenario]\nrig='impact_beam'\nacquisition=3\n[sweep]\nname='x'\n", "a table \\[axes\\]"),
    ],
)
def test_files_that_are_hardly_sweeps_are_refused_in_words(text: str, match: str, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=match):
        load_any(tmp_path / "s.toml")


@pytest.mark.parametrize(
    ("numbers", "said"),
    [([3], "point 3"), ([1, 2, 3], "points 1-3"), ([1, 2, 4, 7, 8], "points 1-2, 4, 7-8")],
)
def test_points_are_named_in_ranges(numbers: list[int], said: str) -> None:
    assert points_named(numbers) == said


@pytest.mark.parametrize("text", ['a "quoted" \\ name', "tab\there", "bell\x07 and \x7f", "ümlaut — 20 µm"])
def test_any_text_comes_back_from_toml(text: str) -> None:
    table = {"name": text, "limits": {text: {"abort": 3.5, "deep.er": {"on": True}}}, "list": ["a", 2]}
    assert tomllib.loads(toml_of(table)) == table
