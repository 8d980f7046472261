"""The rigs on emulated benches with what the seeds drive them by besides: a DC supply, and a person."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from daq.log.reader import LogReader
from daq.log.recover import verify_log
from tests.end_to_end.command import Ended, rattle
from tests.end_to_end.files import write_crank, write_scenario

pytestmark = [pytest.mark.timeout(400), pytest.mark.long]
DEADLINE_S = 300.0
RATE = 25_600.0
BEAM, PLANAR, SPATIAL = "impact_beam", "planar_slider_crank", "spatial_slider_crank"


def run(folder: Path, rig: str, bench: str) -> Ended:
    path = folder / "scenario.toml"
    scenario = write_scenario(path, settle_s=1.0) if rig == BEAM else write_crank(path, rig)
    (folder / "bench.toml").write_text(f"{bench}\n[emulation]\nseed = 7\n")
    return rattle("run", scenario, "--bench", folder / "bench.toml", "--out", folder, deadline_s=DEADLINE_S)


def speed_rpm(log: LogReader, rig: str) -> float:
    if rig == PLANAR:
        angle = log.series("measured", "crank.angle").values
        return float(np.polyfit(np.arange(len(angle)) / RATE, angle, 1)[0] * 60.0 / math.tau)
    mark = log.series("measured", "flywheel.marker").values
    marks = np.flatnonzero(np.diff((mark > 2.5).astype(int)) == 1)
    return float(60.0 * (len(marks) - 1) * RATE / (marks[-1] - marks[0]))


@pytest.mark.parametrize(("rig", "rpm"), [(PLANAR, 200.0), (SPATIAL, 230.0)])
@pytest.mark.parametrize(
    ("table", "off_by", "code"), [("dc_supply", 1e-3, "motor.trimmed"), ("manual_motor", 0.02, "manual.set")]
)
def test_a_crank_turns_as_the_scenario_wants_by_whatever_turns_it(
    rig: str, rpm: float, table: str, off_by: float, code: str, tmp_path: Path
) -> None:
    ended = run(tmp_path, rig, f"[{table}]\nemulated = true\n")
    assert ended.code == 0, ended.err
    verdict = verify_log(ended.log)
    assert verdict.sound
    assert verdict.ledger_missing == 0
    with LogReader(ended.log) as log:
        codes = [event.code for event in log.events()]
        assert speed_rpm(log, rig) == pytest.approx(rpm, rel=off_by)
        predicted = log.channels("predicted")
    assert {code, "twin.aligned", "drive.off"} <= set(codes)
    assert len(predicted) > 4


def test_a_beam_is_shaken_as_the_scenario_wants_by_a_person(tmp_path: Path) -> None:
    ended = run(tmp_path, BEAM, "[manual_shaker]\nemulated = true\n")
    assert ended.code == 0, ended.err
    assert verify_log(ended.log).sound
    with LogReader(ended.log) as log:
        force = log.series("measured", "drive.force").values.astype(float)
        codes = [event.code for event in log.events()]
    turning = np.exp(-2j * np.pi * 20.0 * np.arange(len(force)) / 51_200.0)
    assert abs(2.0 * np.mean(force * turning)) == pytest.approx(9.0, rel=0.05)
    assert {"manual.asked", "manual.set", "twin.aligned", "drive.off"} <= set(codes)


def test_a_supply_that_switches_off_by_itself_ends_the_run(tmp_path: Path) -> None:
    scenario = write_crank(tmp_path / "scenario.toml", SPATIAL, 8.0)
    bench = '[dc_supply]\nemulated = true\n[emulation]\nseed = 7\nfaults = ["dc_supply.trips@12"]\n'
    path = tmp_path / "bench.toml"
    path.write_text(bench)
    ended = rattle("run", scenario, "--bench", path, "--out", tmp_path, deadline_s=DEADLINE_S)
    assert ended.code == 1
    assert "it has switched its output off: over temperature" in ended.err
    assert verify_log(ended.log).sound
