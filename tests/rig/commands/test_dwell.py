"""`rattle dwell`: what is refused before anything moves. The moves are in tests/end_to_end/test_dwells.py."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from daq.log.writer import LogWriter
from rig.files.scenario import Scenario, load_scenario, parse_scenario
from rig.session import dwells
from rig.session.dwells import DwellRequest
from tests.rig.commands.cli import Call

SCENARIOS = Path(__file__).parents[3] / "scenarios"
CRANK = SCENARIOS / "planar_slider_crank.toml"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--speeds", ""), r"--speeds"),
        (("--speeds", "60 rpm, 3 N"), r"drive\.speed"),
        (("--speeds", "60 rpm, 3000 rpm"), r"drive\.speed.*inverter\.maximum_speed"),
        (("--speeds", "60 rpm", "--each", "0 s"), r"--each.*1 s to 600 s"),
    ],
)
def test_wrong_speeds_and_times_are_refused(
    call: Call, tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    answer = call("dwell", CRANK, *options, "--out", tmp_path)
    assert answer.code == 2
    assert re.search(said, answer.err.replace("\n", " "))
    assert not list(tmp_path.iterdir())


def test_a_note_stands_in_the_scenario_of_every_speed(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted: list[Scenario] = []

    def recorded(request: DwellRequest, *_: object) -> Path:
        wanted.extend(request.scenarios)
        return tmp_path / "log.mcap"

    monkeypatch.setattr(dwells, "record_dwells", recorded)
    answer = call("dwell", CRANK, "--speeds", "60 rpm, 90 rpm", "--note", "operator=Ada", "--out", tmp_path)
    assert answer.code == 0, answer.err
    assert [parse_scenario(each.text).notes["operator"] for each in wanted] == ["Ada", "Ada"]


def test_a_rig_that_does_not_turn_is_refused(call: Call, tmp_path: Path) -> None:
    answer = call("dwell", SCENARIOS / "impact_beam.toml", "--speeds", "60 rpm", "--out", tmp_path)
    assert answer.code == 2
    assert "drive.speed" in answer.err


def test_a_log_of_several_speeds_is_nothing_that_a_twin_follows(call: Call, tmp_path: Path) -> None:
    run = tmp_path / "dwells.mcap"
    with LogWriter(run) as log:
        log.add_metadata("scenario", {"toml": load_scenario(CRANK).text})
        log.add_metadata("run", {"dwells": "60, 280 rpm, 8 s each"})
    for command in (
        ("overlay", run),
        ("calibrate", run, "-o", tmp_path / "model.toml"),
        ("diagnose", run, "--out", tmp_path / "answer"),
    ):
        answer = call(*command)
        assert answer.code == 1
        assert "recorded at several speeds (60, 280 rpm, 8 s each)" in answer.err
