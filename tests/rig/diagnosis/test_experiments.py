"""Further runs that a bench could make, as scenarios that parse and differ in what they say."""

from __future__ import annotations

import json
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from rig.diagnosis.experiments import Experiment, options
from rig.files.faults import toml_of
from rig.files.scenario import parse_scenario
from rig.rigs import RIGS
from rig.twin.scenario_twin import twin_of

SCENARIOS = sorted(path for path in Path("scenarios").glob("*.toml") if "." not in path.stem)
RATE = 25_600.0
BEAM = """
name = "beam"
rig = "impact_beam"

[model]
clearance = "0.127 mm"

[drive]
frequency = "20 Hz"
amplitude = 9

[acquisition]
sample_rate = "51.2 kHz"
duration = "5 s"

[limits."contact.force_upper"]
abort = "400 N"
hold = "10 ms"
"""


def channels(text: str) -> tuple[str, ...]:
    return twin_of(parse_scenario(text)).channels


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_every_option_of_every_scenario_parses_and_is_another_run_of_the_same_rig(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    found = options(text, channels(text), RATE)
    assert 1 <= len(found) <= 5
    before = parse_scenario(text)
    for option in found:
        scenario = parse_scenario(option.scenario)
        assert scenario.rig == before.rig
        assert (scenario.drive, scenario.model) != (before.drive, before.model)
        assert scenario.acquisition.sample_rate == before.acquisition.sample_rate
        assert scenario.acquisition.duration >= before.acquisition.duration
        assert scenario.limits == before.limits
        assert scenario.name.startswith(before.name)
        (run,) = option.campaign.runs
        assert set(run.columns.channels) <= set(channels(text))
    assert len({option.scenario for option in found}) == len(found)


def test_an_option_is_the_run_with_one_setting_changed() -> None:
    first, *others = options(BEAM, channels(BEAM), RATE)
    scenario = parse_scenario(first.scenario)
    assert scenario.drive.frequency == 40.0
    assert scenario.name == "beam: frequency 40 Hz"
    assert first.campaign.runs[0].columns.frequency == 40.0
    changed = [
        (each.drive.frequency, each.drive.amplitude, each.model["clearance"])
        for each in (parse_scenario(option.scenario) for option in others)
    ]
    assert changed == [
        (10.0, 9.0, pytest.approx(0.127e-3)),
        (20.0, 9.0, pytest.approx(0.254e-3)),
        (20.0, 11.7, pytest.approx(0.127e-3)),
        (20.0, 9.0, pytest.approx(0.0635e-3)),
    ]


def test_what_the_scenario_does_not_say_is_not_changed() -> None:
    found = options(BEAM.replace('clearance = "0.127 mm"', "modes = 12"), channels(BEAM), RATE)
    assert [tuple(tomllib.loads(option.scenario)["model"]) for option in found] == [("modes",)] * 3


def test_a_run_that_no_scenario_may_ask_for_is_no_option() -> None:
    wide = BEAM.replace('"0.127 mm"', '"9 mm"')  # up to 10 mm
    found = [parse_scenario(option.scenario) for option in options(wide, channels(wide), RATE)]
    assert min(each.model["clearance"] for each in found) == pytest.approx(4.5e-3)
    assert max(each.model["clearance"] for each in found) == pytest.approx(9e-3)


def test_a_further_run_is_long_enough_to_be_diagnosed() -> None:
    short = BEAM.replace('"5 s"', '"0.7 s"')
    assert all(option.campaign.runs[0].cycles >= 5 for option in options(short, channels(short), RATE))


def test_a_further_run_is_as_long_as_the_record_was_where_that_ended_before_it_was_asked_to() -> None:
    first, *_ = options(BEAM.replace('"5 s"', '"86400 s"'), channels(BEAM), RATE, recorded_s=12.004)
    assert parse_scenario(first.scenario).acquisition.duration == 12.0


@pytest.mark.parametrize("kind", RIGS.values(), ids=list(RIGS))
def test_variations_name_keys_of_the_rig_s_scenario(kind: Any) -> None:
    assert all(factor > 0 and factor != 1 for change in kind.variations for factor in change.values())
    assert len(kind.variations) >= 2


@pytest.mark.parametrize(
    "table",
    [
        {"name": 'a "quoted" \\ name', "model": {"clearance": "1 mm", "modes": 15, "flag": True}},
        {"limits": {"contact.force_upper": {"abort": "400 N"}, "drive.force": {"warning": 8.5}}},
        {"name": "x", "empty": {}},
        {"drive": {"amplitude": 1e-7, "offset": -0.5}},
    ],
    ids=["texts", "nested", "empty", "numbers"],
)
def test_a_table_written_as_toml_is_read_back(table: dict[str, Any]) -> None:
    assert tomllib.loads(toml_of(table)) == table


def test_an_experiment_is_told_as_the_interface_has_it() -> None:
    told = json.loads(json.dumps(asdict(Experiment("text", ("a", "b"), 0.97))))
    assert told == {"scenario": "text", "separates": ["a", "b"], "expected_probability": 0.97}
