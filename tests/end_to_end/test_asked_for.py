"""What the command line says beside the files: other values, how long, and an answer for another program."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from daq.log.reader import LogReader
from daq.log.recover import verify_log
from rig.files.scenario import parse_scenario
from tests.end_to_end.command import await_true, command
from tests.end_to_end.files import CHANNELS, write_scenario


@pytest.mark.long
def test_a_run_with_other_values_until_enter_for_another_program(tmp_path: Path) -> None:
    """Enter is pressed again and again from the start on: what comes in the record ends it."""
    settings = ("--set", "drive.frequency=21 Hz", "--set", "model.clearance=0.2 mm", "--set", 'name="other"')
    settings += ("--note", "operator=Ada", "--note", "specimen=steel 3")
    asked = (*settings, "--until-stopped", "--json", "--out", tmp_path)
    scenario = write_scenario(tmp_path / "s.toml", duration_s=60.0)
    with command("run", scenario, *asked, typed="\n") as running:

        def ended_with_enter() -> bool:
            running.type("\n")
            return running.ended

        await_true("it ends with Enter", ended_with_enter, 90.0)
        ended = running.end()
    assert ended.code == 0, ended.err
    answer = json.loads(ended.out)
    path = Path(answer["log"])
    assert path.parent == tmp_path
    assert Path(answer["report"]).is_file()
    assert "Enter ends the record, at the latest after " in ended.err
    assert "the drive is off\n" in ended.err
    assert 0.05 < answer["duration_s"] < 1.0
    assert list(answer["channels"]) == list(CHANNELS)
    assert answer["channels"]["drive.force"]["unit"] == "N"
    assert 3.0 < answer["channels"]["drive.force"]["measured"]["rms"] < 10.0
    assert (answer["missing"], answer["overloaded_blocks"]) == (0, 0)
    assert verify_log(path).sound
    with LogReader(path) as log:
        assert "record.end" in [event.code for event in log.events()]
        ran = parse_scenario(log.scenario)
        remark = log.scenario.splitlines()[0]
    assert (ran.name, ran.drive.frequency, ran.model["clearance"]) == ("other", 21.0, 0.0002)
    assert remark.startswith(
        '# s.toml with notes.operator = "Ada", notes.specimen = "steel 3", '
        'drive.frequency = "21 Hz", model.clearance = "0.2 mm", name = "other"'
    )
    assert ran.notes == {"operator": "Ada", "specimen": "steel 3"}
