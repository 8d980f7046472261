from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import ConfigurationError
from rig.files.effects_file import load_effects, parse_effects
from sim_twin.rigs.impact_beam.effects import EFFECTS
from tests.rig.files.faulty import only_problem, problems_of

# three effects of physics.md section 4
CATALOGUE = {name: EFFECTS[name] for name in ("clearance", "base_flexibility", "sensor_gain")}
BASE = {
    "name": "base_flexibility",
    "parameters": {"frequency_hz": 420, "mass_kg": 1.5, "damping_ratio": 0.02},
}


def gain(channel: object, value: object = 1.2) -> dict[str, object]:
    return {"name": "sensor_gain", "parameters": {"channel": channel, "gain": value}}


def parse(entries: object) -> object:
    return parse_effects(json.dumps(entries), "effects", CATALOGUE)


def test_effects_are_read_as_names_and_numbers() -> None:
    effects = parse([BASE, gain("yoke.force"), gain("drive.force", 0.5)])
    assert effects == (
        ("base_flexibility", {"frequency_hz": 420.0, "mass_kg": 1.5, "damping_ratio": 0.02}),
        ("sensor_gain", {"channel": "yoke.force", "gain": 1.2}),
        ("sensor_gain", {"channel": "drive.force", "gain": 0.5}),
    )


def test_empty_list_is_no_effect(tmp_path: Path) -> None:
    path = tmp_path / "effects.json"
    path.write_text("[]")
    assert load_effects(path, CATALOGUE) == ()


@pytest.mark.parametrize(
    ("entries", "key", "allowed"),
    [
        ({}, "effects", "a list such as"),
        ([3], "[1]", "an object"),
        ([{"name": "clearence", "parameters": {"scale": 1.5}}], "[1].name", "did you mean clearance?"),
        ([{"name": ["clearance"], "parameters": {}}], "[1].name", "an effect of this rig"),
        ([{"name": "clearance", "parameters": []}], "[1].parameters", "an object"),
        ([{"name": "clearance", "parameters": {}}], "[1].clearance.scale", "0.5 to 0.9 or 1.1 to 2"),
        (
            [{"name": "clearance", "parameters": {"scale": 1.0}}],
            "[1].clearance.scale",
            "0.5 to 0.9 or 1.1 to 2",
        ),
        ([{"name": "clearance", "parameters": {"scale": "1.5"}}], "[1].clearance.scale", "0.5 to 0.9"),
        ([{"name": "clearance", "parameters": {"scale": True}}], "[1].clearance.scale", "0.5 to 0.9"),
        ([{"name": "clearance", "parameters": {"scale": 10**400}}], "[1].clearance.scale", "0.5 to 0.9"),
        ([{"name": "clearance", "parameters": {"scale": float("nan")}}], "[1].clearance.scale", "0.5 to 0.9"),
        (
            [{"name": "clearance", "parameters": {"scale": 1.5, "scael": 1}}],
            "[1].clearance.scael",
            "mean [1].clearance.scale?",
        ),
        ([{"name": "clearance", "parameters": {"scale": 1.5}, "value": 1}], "[1].value", "unknown key"),
        ([BASE, BASE], "[2].name", "once in a file"),
        ([gain("yoke.force"), gain("yoke.force", 0.5)], "[2].name", "once a channel"),
        ([gain("base.acceleration")], "[1].sensor_gain.channel", "one of drive.force, contact.force_upper"),
        ([gain(["yoke.force"])], "[1].sensor_gain.channel", "one of drive.force"),
    ],
)
def test_faulty_effect_is_told(entries: object, key: str, allowed: str) -> None:
    assert allowed in only_problem(lambda: parse(entries), key).allowed


def test_range_is_told_with_its_unit() -> None:
    faulty = {
        "name": "base_flexibility",
        "parameters": {"frequency_hz": 50, "mass_kg": 9, "damping_ratio": 0.02},
    }
    problems = problems_of(lambda: parse([faulty, {"name": "none"}]))
    assert problems["[1].base_flexibility.frequency_hz"].allowed == "150 to 1500 Hz"
    assert problems["[1].base_flexibility.mass_kg"].allowed == "0.5 to 8 kg"
    assert "[2].name" in problems


@pytest.mark.parametrize("text", ["[{]", "[" * 100_000, '[{"name": "a", "name": "b"}]', ""])
def test_text_that_is_no_json_is_told(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"JSON = \(syntax\)"):
        parse_effects(text, "effects", CATALOGUE)


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.sampled_from(["clearance", "scale"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["name", "parameters", "scale"]), inner, max_size=3)
    ),
    max_leaves=10,
)


@given(value=JSON_VALUES)
def test_any_json_gives_effects_or_a_configuration_error(value: object) -> None:
    with contextlib.suppress(ConfigurationError):
        assert isinstance(parse(value), tuple)
