"""`rattle scenario`: a file with every key, that is what a scenario with none of them is."""

from __future__ import annotations

import dataclasses
import re

import pytest

from daq.quantity import settings_of
from rig.files.scenario import parse_scenario
from rig.files.whole_scenario import whole_scenario
from rig.rigs import RIGS
from rig.twin.scenario_twin import twin_of

RIG = pytest.mark.parametrize("rig", RIGS)
_OFF = re.compile(r"^# (\w+) = (.*?)\s+# (.*)$", re.MULTILINE)


def numbers(part: object, place: str = "") -> dict[str, float]:
    """All of a twin, by place; a word or nothing counts as a number of its own."""
    if dataclasses.is_dataclass(part):
        inner = {each.name: getattr(part, each.name) for each in dataclasses.fields(part)}
    elif isinstance(part, dict):
        inner = part
    elif isinstance(part, tuple):
        inner = dict(enumerate(part))
    elif isinstance(part, int | float):
        return {place: float(part)}
    else:
        return {f"{place} {part}": 1.0}
    return {
        name: value for key, each in inner.items() for name, value in numbers(each, f"{place}/{key}").items()
    }


@RIG
def test_it_is_the_scenario_with_nothing_said_of_the_rig(rig: str) -> None:
    text = whole_scenario(RIGS[rig])
    whole = parse_scenario(text)
    few = parse_scenario(text[: text.index("[model]")] + text[text.index("[drive]") :])
    assert few.model == {}
    assert len(whole.model) > 5
    assert numbers(twin_of(whole)) == pytest.approx(numbers(twin_of(few)), rel=1e-14, abs=0.0)


@RIG
def test_every_key_stands_in_it_once_and_says_where_its_value_is_from(rig: str) -> None:
    kind, text = RIGS[rig], whole_scenario(RIGS[rig])
    for key in (*kind.keys, *settings_of(kind.drive)):
        (line,) = re.findall(rf"^(?:# )?{key} = .*$", text, re.MULTILINE)
        said = line.rpartition("# ")[2]
        assert said.count("; ") >= 1
    assert "Deck and Dubowsky, table" in text or "Erkaya, table 1" in text


@RIG
def test_a_key_that_another_decides_may_be_given_with_it(rig: str) -> None:
    text = whole_scenario(RIGS[rig])
    start = text[: text.index("[model]")] + "{model}" + text[text.index("[drive]") :]
    off = _OFF.findall(text[: text.index("[drive]")])
    assert off
    for key, value, said in off:
        if value.strip() == "...":  # what no word gives the rig has no default
            continue
        with_words = re.search(r"with (.*?);", said)
        words = (with_words[1] if with_words else "").replace(", ", "\n")
        model = f"[model]\n{words}\n{key} = {value}\n"
        scenario = parse_scenario(start.replace("{model}", model))
        without = parse_scenario(start.replace("{model}", f"[model]\n{words}\n"))
        assert key in scenario.model
        # it is the default there
        assert numbers(twin_of(scenario)) == pytest.approx(numbers(twin_of(without)), rel=1e-14, abs=0.0)


@RIG
def test_every_section_stands_in_it_and_its_notes_are_read_as_they_stand(rig: str) -> None:
    text = whole_scenario(RIGS[rig])
    for section in ("model", "drive", "acquisition", "tolerances", "limits", "notes"):
        assert re.search(rf"^(?:# )?\[{section}[\].]", text, re.MULTILINE), section
    head, notes = text.split("# [notes]\n")
    given = parse_scenario(f"{head}[notes]\n" + re.sub(r"^# ", "", notes, flags=re.MULTILINE))
    assert given.notes == {"operator": "...", "specimen": "..."}
    assert parse_scenario(text).notes == {}


def test_a_part_that_is_not_there_has_no_keys() -> None:
    text = whole_scenario(RIGS["impact_beam"])
    thicker = text.replace("# base_plate_thickness", "base_plate_thickness")
    with pytest.raises(Exception, match=r"base_plate_thickness = .*another base than rigid"):
        parse_scenario(thicker)
    covered = thicker.replace('base = "rigid"', 'base = "flexible"')
    scenario = parse_scenario(covered.replace("12.7 mm", "10 mm"))
    assert twin_of(scenario).rig.base.sheet.thickness == pytest.approx(0.01)
    bare = covered.replace("# base_cover_frame_mass", "base_cover_frame_mass")
    with pytest.raises(Exception, match="base_cover_frame_mass"):
        parse_scenario(bare)


def test_lists_are_as_long_as_they_are() -> None:
    text = whole_scenario(RIGS["spatial_slider_crank"])
    wrong = text.replace('slider_pin = ["0 mm", "0 mm", "0 mm"]', 'slider_pin = ["0 mm", "1 mm"]')
    assert wrong != text
    with pytest.raises(Exception, match=r"slider_pin.* a list of 3, each -100 mm to 100 mm"):
        parse_scenario(wrong)


def test_a_length_that_may_be_taken_for_its_double_says_what_it_is() -> None:
    for rig in ("impact_beam", "planar_slider_crank", "spatial_slider_crank"):
        lines = re.findall(r"^\w*clearance\w* = .*", whole_scenario(RIGS[rig]), re.MULTILINE)
        assert lines
        assert all("half of" in line for line in lines)
