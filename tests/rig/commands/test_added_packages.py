"""What other packages add in vain is told by name; everything else works."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from benchmarks.start import RATTLE
from tests.fake_packages import install

SCENARIO = Path(__file__).parents[3] / "scenarios" / "impact_beam.toml"
BEAM = "from rig.rigs.impact_beam import KIND\n"


def rattle(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S603
        [*RATTLE, *arguments],
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("points", "code", "told"),
    [
        (
            {"shaking_table": "added:KIND"},
            "raise RuntimeError('no licence')\n",
            "shaking_table of added 1.2 is not used: it does not load (RuntimeError: no licence)",
        ),
        (
            {"impact_beam": "added:KIND"},
            BEAM,
            "impact_beam of added 1.2 is not used: that of rattle itself has the name",
        ),
        (
            {"shaking_table": "added:KIND"},
            BEAM,
            "shaking_table of added 1.2 is not used: added:KIND calls itself impact_beam",
        ),
    ],
)
def test_a_rig_that_cannot_be_used_costs_only_itself(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, points: dict[str, str], code: str, told: str
) -> None:
    install(monkeypatch, tmp_path, "added", "rattle.rigs", points, code)
    checked = rattle(tmp_path, "check", str(SCENARIO))
    assert (checked.returncode, checked.stdout) == (0, f"{SCENARIO}: scenario, no faults\n")
    assert checked.stderr == f"! rattle.rigs: {told}\n"


def test_a_rig_that_does_not_load_is_told_where_a_file_asks_for_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install(monkeypatch, tmp_path, "added", "rattle.rigs", {"shaking_table": "added:KIND"}, "import absent\n")
    scenario = tmp_path / "table.toml"
    scenario.write_text('rig = "shaking_table"\n')
    run = rattle(tmp_path, "predict", str(scenario), "--out", str(tmp_path / "out.mcap"))
    first, *rest = run.stderr.splitlines()
    assert (run.returncode, first) == (
        2,
        "! rattle.rigs: shaking_table of added 1.2 is not used: it does not load "
        "(ModuleNotFoundError: No module named 'absent')",
    )
    assert any('"impact_beam" or "planar_slider_crank" or "spatial_slider_crank"' in line for line in rest)


def test_an_instrument_that_cannot_be_used_costs_only_itself(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install(monkeypatch, tmp_path, "added", "rattle.instruments", {"inverter": "added:X", "laser": "added:X"})
    checked = rattle(tmp_path, "check", str(SCENARIO))
    assert checked.returncode == 0
    assert checked.stderr == (
        "! rattle.instruments: inverter of added 1.2 is not used: that of rattle itself has the name\n"
        "! rattle.instruments: laser of added 1.2 is not used: it does not load "
        "(AttributeError: module 'added' has no attribute 'X')\n"
    )


WORN_STOPS = """
from dataclasses import replace
from sim_twin.effects import Effect, Parameter

def clearer(twin, values):
    return replace(twin, rig=replace(twin.rig, clearance=twin.rig.clearance * values["scale"]))

WORN = Effect("worn_stops", "contact joint", (Parameter("scale", "", ((1.1, 2.0),)),), clearer)
"""


def test_an_effect_of_another_package_is_one_of_its_rig(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    points = {
        "impact_beam.worn_stops": "added:WORN",
        "impact_beam.clearance": "added:WORN",
        "planar_slider_crank.worn_guide": "added:WORN",
    }
    install(monkeypatch, tmp_path, "added", "rattle.effects", points, WORN_STOPS)
    listed = rattle(tmp_path, "effects", str(SCENARIO), "--json")
    names = [each["name"] for each in json.loads(listed.stdout)]
    assert [name for name in names if name in ("clearance", "worn_stops")] == ["clearance", "worn_stops"]
    whose = "impact_beam.clearance of added 1.2"
    assert listed.stderr == f"! rattle.effects: {whose} is not used: that of rattle itself has the name\n"
