"""`rattle effects`: the list holds what an effects file may hold."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.rig.commands.cli import Call

SCENARIOS = Path(__file__).parents[3] / "scenarios"
RIGS = ("impact_beam", "planar_slider_crank", "spatial_slider_crank")


def last_word(text: str) -> str:
    return text.split()[-1]


@pytest.mark.parametrize("rig", RIGS)
def test_every_effect_has_a_row_with_its_ranges(call: Call, rig: str) -> None:
    file = SCENARIOS / f"{rig}.toml"
    told, table = call("effects", file, "--json"), call("effects", file)
    assert (told.code, table.code) == (0, 0), told.err + table.err
    for effect in json.loads(told.out):
        assert effect["name"] in table.out
        assert effect["location"] in table.out
        for name, allowed in effect["parameters"].items():
            assert effect["refused"] or (name in table.out and last_word(allowed) in table.out)


def test_an_effect_from_the_list_is_taken_and_one_that_is_not_is_called_unknown(
    call: Call, tmp_path: Path
) -> None:
    scenario, file = SCENARIOS / "impact_beam_from_rest.toml", tmp_path / "effects.json"
    predict = ("predict", scenario, "--effects", file, "--out", tmp_path / "twin.mcap")
    listed = json.loads(call("effects", scenario, "--json").out)
    assert "clearance" in {effect["name"] for effect in listed}
    file.write_text('[{"name": "clearance", "parameters": {"scale": 1.6}}]')
    assert call(*predict).code == 0
    (tmp_path / "twin.mcap").unlink()
    file.write_text('[{"name": "clearences", "parameters": {"scale": 1.6}}]')
    refused = call(*predict)
    assert refused.code == 2
    assert "unknown effect; did you mean clearance?" in refused.err
