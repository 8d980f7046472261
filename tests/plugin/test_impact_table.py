"""A rig of another installed package does what the rigs of this one do, with no edit here."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from benchmarks.start import RATTLE
from daq.log.reader import LogReader

HERE = Path(__file__).parent
SCENARIO = HERE / "impact_table.toml"
PACKAGE = HERE / "impact_table"
BENCH = PACKAGE / "impact_table.toml"
ADDED: Mapping[str, Mapping[str, str]] = tomllib.loads((HERE / "pyproject.toml").read_text())["project"][
    "entry-points"
]
PARTS = ("daq", "drivers", "rig", "sim_twin")
_USED = """
import json
from daq.formats import FORMATS, all_formats
from daq.plugins import UNUSED, plugins
from drivers.ni_daq.sensors import SENSORS
from rig.instruments import INSTRUMENTS
from rig.pages.content import Section
from rig.report.page import GROUP, SECTIONS
from rig.rigs import RIGS

formats, sections = all_formats(), plugins(GROUP, Section, taken=SECTIONS)
effects = [f"{rig}.{e}" for rig in RIGS for e in RIGS[rig].nominal().model.effects.added]
print(json.dumps({
    "unused": UNUSED,
    "rattle.rigs": sorted(RIGS.added),
    "rattle.instruments": sorted(INSTRUMENTS.added),
    "rattle.sensors": sorted(SENSORS.added),
    "rattle.effects": sorted(effects),
    "rattle.formats": sorted(formats.keys() - FORMATS.keys()),
    GROUP: sorted(sections.found),
}))
"""
ROOT = HERE.parents[1]
Rattle = Callable[..., str]


@pytest.fixture
def site(tmp_path: Path) -> Mapping[str, str]:
    """The environment of processes in which the package is installed by what its pyproject.toml says."""
    metadata = tmp_path / "site" / "impact_table-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: impact-table\nVersion: 1.0\n")
    lines = [
        line
        for group, points in ADDED.items()
        for line in (f"[{group}]", *(f"{name} = {place}" for name, place in points.items()))
    ]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (metadata.parent, HERE, ROOT)))}


@pytest.fixture
def rattle(site: Mapping[str, str], tmp_path: Path) -> Rattle:
    """Runs the command where the package is installed."""

    def run(*arguments: str | Path, refused: bool = False) -> str:
        done = subprocess.run(  # noqa: S603
            [*RATTLE, *map(str, arguments)],
            env=site,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode != 0) is refused, done.stderr
        assert "!" not in done.stderr
        return done.stderr if refused else done.stdout

    return run


def test_the_project_names_nothing_of_it() -> None:
    """Each thing that it adds costs no line outside of it."""
    names = {name.rpartition(".")[2] for points in ADDED.values() for name in points}
    named = re.compile(rf"(?<![\w.])({'|'.join(sorted({*names, PACKAGE.name}))})\b")
    found = {
        f"{path.relative_to(ROOT)}: {hit[0]}"
        for part in PARTS
        for path in (ROOT / part).rglob("*")
        if path.suffix in {".py", ".toml"}
        for hit in named.finditer(path.read_text())
    }
    assert found == set()


def test_it_adds_to_each_table_that_is_open_and_all_of_it_is_used(site: Mapping[str, str]) -> None:
    opened = {
        group
        for part in PARTS
        for path in (ROOT / part).rglob("*.py")
        for group in re.findall(r'"(rattle\.[a-z_]+)"', path.read_text())
    }
    assert {*ADDED, "rattle.subjects"} == opened  # an installed subject is diagnosed in tests/own_rigs
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", _USED], env=site, capture_output=True, text=True, check=True
    )
    used = json.loads(done.stdout)
    assert used == {"unused": []} | {group: sorted(points) for group, points in ADDED.items()}


def test_its_scenario_is_checked(rattle: Rattle, tmp_path: Path) -> None:
    assert rattle("check", SCENARIO) == f"{SCENARIO}: scenario, no faults\n"
    bench = tmp_path / "bench.toml"
    bench.write_text(BENCH.read_text())
    assert rattle("check", bench) == f"emergency stop: none is read\n{bench}: bench, no faults\n"


@pytest.mark.parametrize(
    ("given", "wrong", "told"),
    [
        ('"acceleration_mems"', '"acceleration_mens"', '"tachometer" or "acceleration_mems"'),
        ("cDAQ1Mod1/ai2", "cDAQ1Mod1/ctr2", '"encoder" or "marker" or "tachometer" on a counter'),
        ('sensitivity = "100 mV/g"', "", "(missing): a sensitivity"),
        ('"50 g"', '"-1 g"', "above 0 m/s2, up to 1e+06 m/s2"),
    ],
)
def test_its_kind_of_sensor_is_one_that_a_channel_may_have(
    rattle: Rattle, tmp_path: Path, given: str, wrong: str, told: str
) -> None:
    bench = tmp_path / "bench.toml"
    before, kind, after = BENCH.read_text().partition('kind = "acceleration_mems"')
    where = before[: before.rindex("[[")], before[before.rindex("[[") :] + kind + after
    bench.write_text(where[0] + where[1].replace(given, wrong))
    assert told in rattle("check", bench, refused=True)


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


@pytest.mark.long
def test_it_runs_on_its_emulated_bench_and_is_replayed(rattle: Rattle, tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text('[thermometer]\nemulated = true\nperiod = "0.25 s"\n')
    rattle("run", SCENARIO, "--bench", bench, "--out", tmp_path / "runs")
    (log,) = (tmp_path / "runs").glob("*.mcap")
    page = log.with_suffix(".html").read_text()
    assert re.search(r"Hardest blow.*measured: [1-9][0-9.]* N.*predicted: [1-9][0-9.]* N", page, re.DOTALL)
    assert "loose_mass" not in page
    with LogReader(log) as run:
        assert run.metadata["run"]["emulated"] == "shaker card thermometer"
        assert run.metadata["run"]["instrument.thermometer"] == "PT100 of the hall"
        hall = run.series("measured", "hall.temperature")
        assert hall.values.tolist() == [293.5, 294.0, 294.5, 293.5]
        assert hall.sample_rate == 4.0
        (mems,) = (c for c in run.channels("measured").values() if c.sensor == "acceleration_mems")
        assert (mems.name, mems.raw_unit) == ("table.acceleration", "V")
        for origin in ("measured", "predicted"):
            assert set(run.channels(origin)) >= {"drive.force", "stop.force", "table.acceleration"}
            assert len(run.series(origin, "stop.force").values) == 51_200
        measured, predicted = (
            run.series(origin, "table.acceleration").values for origin in ("measured", "predicted")
        )
    # another gap and drive by some percent, and impacts that part: alike in power, not in waveform
    assert np.std(measured) == pytest.approx(np.std(predicted), rel=0.3)
    replayed = rattle("replay", log, "--speed", "0")
    assert "stop.force" in replayed
    assert "hall.temperature" in replayed
    assert "measured   stop: " in rattle("overlay", log, "--out", tmp_path / "overlay.mcap")
    assert "measured: " in (tmp_path / "overlay.html").read_text().split("Hardest blow")[-1]
    rattle("export", log, "--to", "largest_values", "--out", tmp_path / "run.largest")
    assert "measured hall.temperature 294.5\n" in (tmp_path / "run.largest").read_text()


@pytest.mark.long
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
