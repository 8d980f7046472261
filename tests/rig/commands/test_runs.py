"""`rattle runs`: what the runs of a folder were, their tags, and two of them side by side."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from daq.log.reader import LogReader
from rig.report.catalogue import TAGS, runs_in
from rig.report.record import read_run
from rig.report.summary import as_json
from tests.rig.commands.cli import Call
from tests.rig.synthetic_run import BLOCK, CHANNELS, SCENARIO, write_log

NOTES = '[notes]\noperator = "Ada"\nspecimen = "steel 3"\nheat = 21\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs, of which one has notes, and a file that only looks like one."""
    folder = tmp_path_factory.mktemp("runs")
    write_log(folder / "plain.mcap", seconds=0.5, origins=("measured",))
    write_log(folder / "noted.mcap", scenario=SCENARIO.replace("9 N", "8 N") + NOTES)
    (folder / "broken.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(50))
    return folder


def listed(call: Call, *arguments: object) -> list[str]:
    answer = call("runs", *arguments, "--json")
    assert answer.code == 0, answer.err
    return [Path(each["log"]).stem for each in json.loads(answer.out)]


def test_a_folder_is_listed_with_notes_and_what_cannot_be_read(call: Call, folder: Path) -> None:
    answer = call("runs", folder)
    assert answer.code == 0
    lines = [line.strip() for line in answer.out.splitlines()]
    noted = lines.index("2026-09-21 14:13  noted.mcap")
    assert lines[noted + 1] == "synthetic beam; operator: Ada; specimen: steel 3; heat: 21"
    assert "broken.mcap: not a log" in lines[lines.index("broken.mcap") + 1]
    assert answer.out.rstrip().endswith("3 runs")


@pytest.mark.parametrize(
    ("where", "found"),
    [
        (["operator=ada"], ["noted"]),
        (["specimen=steel*"], ["noted"]),
        (["drive.amplitude=9 N"], ["plain"]),
        (["rig=impact*", "heat=21"], ["noted"]),
        (["rig=impact*"], ["noted", "plain"]),
        (["operator=Bert"], []),
        (["id=run-7"], ["noted", "plain"]),
    ],
)
def test_runs_are_chosen_by_notes_scenario_and_record(
    call: Call, folder: Path, where: list[str], found: list[str]
) -> None:
    options = [part for each in where for part in ("--where", each)]
    assert sorted(listed(call, folder, *options)) == found


def test_tags_stand_beside_the_logs_which_stay_as_they_are(call: Call, folder: Path) -> None:
    log = folder / "noted.mcap"
    before = log.read_bytes()
    assert call("runs", log, "--tag", "good", "--tag", "first look").code == 0
    assert listed(call, folder, "--tagged", "good") == ["noted"]
    assert call("runs", log, "--untag", "good").code == 0
    assert listed(call, folder, "--tagged", "good") == []
    assert listed(call, folder, "--tagged", "first look") == ["noted"]
    assert log.read_bytes() == before
    assert json.loads((folder / TAGS).read_text()) == {"noted.mcap": ["first look"]}


def test_tags_that_somebody_spoilt_are_told_and_kept(call: Call, tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.mcap", seconds=0.2)
    (tmp_path / TAGS).write_text("{broken")
    answer = call("runs", log, "--tag", "good")
    assert answer.code == 2
    assert "mend or delete it" in answer.err
    assert (tmp_path / TAGS).read_text() == "{broken"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--where", "operator"], "KEY=PATTERN"),
        (["--tag", "good"], "want logs, not a folder"),
        (["--compare"], "--compare wants two runs, not 3"),
    ],
)
def test_what_cannot_be_asked(call: Call, folder: Path, arguments: list[str], told: str) -> None:
    answer = call("runs", folder, *arguments)
    assert answer.code == 2
    assert told in answer.err


def test_two_runs_side_by_side_have_the_figures_of_a_run_and_its_twin(call: Call, folder: Path) -> None:
    """The other run measured what the twin of this one predicted: every figure is the same."""
    with_twin = folder / "noted.mcap"
    other = folder / "other.mcap"
    measured_as_predicted(with_twin, other)
    try:
        answer = call("runs", with_twin, other, "--compare", "--json")
        assert answer.code == 0, answer.err
        found = json.loads(answer.out)
        wanted = as_json(read_run(with_twin))
        assert found["channels"] == wanted["channels"]
        assert found["half_cycles"] == wanted["half_cycles"]
        # peaks of 40 N against 36 N: 0.9 dB; what is noise alone has none
        assert 0.2 < found["apart_db"] < 2.0
        assert ["heat", "21", ""] in found["differences"]
        assert ["drive.amplitude", "8 N", "9 N"] in found["differences"]
        said = call("runs", with_twin, other, "--compare").out
        assert "rms first" in said
        assert "second     first 36.0" in said
        assert "autospectra" in said
    finally:
        other.unlink()


def measured_as_predicted(log: Path, target: Path) -> None:
    from daq.log.writer import LogWriter

    with LogReader(log) as read, LogWriter(target) as written:
        for channel in CHANNELS:
            written.declare("measured", channel)
        written.add_metadata("scenario", {"toml": SCENARIO})
        for _, block in read.blocks("predicted"):
            assert len(block.values) == BLOCK
            assert np.isfinite(block.values).all()
            written.add_block("measured", block, block.time_ns)


def test_runs_of_two_rigs_are_not_compared(call: Call, folder: Path, tmp_path: Path) -> None:
    crank = SCENARIO.replace("impact_beam", "planar_slider_crank")
    other = write_log(tmp_path / "crank.mcap", seconds=0.2, scenario=crank)
    answer = call("runs", folder / "plain.mcap", other, "--compare")
    assert answer.code == 2
    assert "two runs of one rig" in answer.err


def test_the_points_of_a_sweep_are_runs_too(tmp_path: Path) -> None:
    (tmp_path / "by frequency" / "point-0001").mkdir(parents=True)
    write_log(tmp_path / "by frequency" / "point-0001" / "beam.mcap", seconds=0.1)
    assert [run.path.stem for run in runs_in([tmp_path])] == ["beam"]


def test_the_oldest_comes_first(tmp_path: Path) -> None:
    for name in ("b", "a"):
        write_log(tmp_path / f"{name}.mcap", seconds=0.1)
    assert [run.path.stem for run in runs_in([tmp_path])] == ["a", "b"]
