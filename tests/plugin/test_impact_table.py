"""A rig of another installed package does what the rigs of this one do, with no edit here."""

from __future__ import annotations

import json
import os
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.start import RATTLE
from daq.log.reader import LogReader

HERE = Path(__file__).parent
SCENARIO = HERE / "impact_table.toml"
ROOT = HERE.parents[1]
Rattle = Callable[..., str]


@pytest.fixture
def rattle(tmp_path: Path) -> Rattle:
    """Runs the command where the package is installed by what its pyproject.toml says."""
    project = tomllib.loads((HERE / "pyproject.toml").read_text())["project"]
    metadata = tmp_path / "site" / "impact_table-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: impact-table\nVersion: 1.0\n")
    lines = [
        line
        for group, points in project["entry-points"].items()
        for line in (f"[{group}]", *(f"{name} = {place}" for name, place in points.items()))
    ]
    (metadata / "entry_points.txt").write_text("\n".join(lines))

    def run(*arguments: str | Path) -> str:
        done = subprocess.run(  # noqa: S603
            [*RATTLE, *map(str, arguments)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (metadata.parent, HERE, ROOT)))},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert "!" not in done.stderr
        return done.stdout

    return run


def test_its_scenario_is_checked(rattle: Rattle, tmp_path: Path) -> None:
    assert rattle("check", SCENARIO) == f"{SCENARIO}: scenario, no faults\n"
    bench = tmp_path / "bench.toml"
    bench.write_text((HERE / "impact_table" / "impact_table.toml").read_text())
    assert rattle("check", bench) == f"{bench}: bench, no faults\n"


def test_its_instrument_bounds_the_drive(rattle: Rattle, tmp_path: Path) -> None:
    strong = tmp_path / "strong.toml"
    strong.write_text(SCENARIO.read_text().replace("15 N", "40 N"))
    refused = "drive.amplitude = 40 N: up to 30 N (table_shaker.highest)"
    assert f"the emulated one refuses {refused}" in rattle("check", strong)


def test_its_effects_are_its_own_and_those_added_to_it(rattle: Rattle) -> None:
    of_table = [each["name"] for each in json.loads(rattle("effects", SCENARIO, "--json"))]
    assert of_table == ["gap", "contact_stiffness", "table_damping", "sensor_gain", "loose_mass"]
    of_beam = [
        each["name"]
        for each in json.loads(rattle("effects", ROOT / "scenarios" / "impact_beam.toml", "--json"))
    ]
    assert "worn_stops" in of_beam


def test_its_twin_hits_the_stop_and_hardly_with_another_gap(rattle: Rattle, tmp_path: Path) -> None:
    nominal = json.loads(rattle("predict", SCENARIO, "--out", tmp_path / "nominal.mcap", "--json"))
    wide = tmp_path / "wide.json"
    wide.write_text('[{"name": "gap", "parameters": {"scale": 2.0}}]')
    more = ("--effects", wide, "--out", tmp_path / "wide.mcap", "--json")
    other = json.loads(rattle("predict", SCENARIO, *more))
    assert nominal["impacts"] >= 5
    assert other["impacts"] < nominal["impacts"]
    with LogReader(tmp_path / "nominal.mcap") as log:
        stop = log.series("predicted", "stop.force").values
        assert float(np.max(stop)) == pytest.approx(nominal["largest_n"], rel=0.05)  # by its filter


def test_it_runs_on_its_emulated_bench_and_is_replayed(rattle: Rattle, tmp_path: Path) -> None:
    rattle("run", SCENARIO, "--out", tmp_path / "runs")
    (log,) = (tmp_path / "runs").glob("*.mcap")
    page = log.with_suffix(".html").read_text()
    assert "Hardest blow" in page
    assert "loose_mass" not in page
    with LogReader(log) as run:
        assert run.metadata["run"]["emulated"] == "shaker card"
        for origin in ("measured", "predicted"):
            assert set(run.channels(origin)) >= {"drive.force", "stop.force", "table.acceleration"}
            assert len(run.series(origin, "stop.force").values) == 51_200
        measured, predicted = (
            run.series(origin, "table.acceleration").values for origin in ("measured", "predicted")
        )
    # another gap and drive by some percent, and impacts that part: alike in power, not in waveform
    assert np.std(measured) == pytest.approx(np.std(predicted), rel=0.3)
    assert "stop.force" in rattle("replay", log, "--speed", "0")
    assert "stop.force: measured" in rattle("overlay", log, "--out", tmp_path / "overlay.mcap")
    assert "Hardest blow" in (tmp_path / "overlay.html").read_text()


@pytest.mark.slow
def test_a_hidden_effect_is_diagnosed(rattle: Rattle, tmp_path: Path) -> None:
    (tmp_path / "hidden.json").write_text('[{"name": "gap", "parameters": {"scale": 1.6}}]')
    bench, scenario = tmp_path / "bench.toml", tmp_path / "long.toml"
    bench.write_text('[emulation]\neffects = "hidden.json"\nseed = 3\n')
    scenario.write_text(SCENARIO.read_text().replace('duration = "1 s"', 'duration = "3 s"'))
    rattle("run", scenario, "--bench", bench, "--out", tmp_path / "runs")
    logs = tuple((tmp_path / "runs").glob("*.mcap"))
    rattle("diagnose", *logs, "--out", tmp_path / "answer", "--budget", "30", "--seed", "1")
    (effect,) = json.loads((tmp_path / "answer" / "effects.json").read_text())
    assert effect["name"] == "gap"
    assert effect["parameters"]["scale"] == pytest.approx(1.6, rel=0.1)
