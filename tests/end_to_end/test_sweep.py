"""A sweep that is stopped and goes on, and beams that are centred, all on the emulated bench."""

from __future__ import annotations

import json
import signal
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from daq.log.reader import LogReader
from daq.log.recover import verify_log
from daq.signals.sine import fit_sine
from rig.files.scenario import load_scenario
from rig.session.centring import what_is_touched
from tests.end_to_end.command import Ended, command, rattle
from tests.end_to_end.files import write_bench

pytestmark = pytest.mark.long
HERTZ = (20.0, 20.6, 20.0)
SWEEP = """\
[sweep]
name = "short"
up_and_down = ["drive.frequency"]
until = { impacts = 5, longest = "20 s" }
[scenario]
rig = "impact_beam"
[scenario.drive]
frequency = "20 Hz"
[scenario.acquisition]
sample_rate = "51.2 kHz"
settle = "0.9 s"
[axes]
"drive.frequency" = { from = "20 Hz", to = "20.6 Hz", steps = 2 }
"""
SHAKER = """\
rig = "impact_beam"
[model]
shaker_stiffness = "3 kN/m"
shaker_damping = "20 N s/m"
shaker_mass = "20 g"
[drive]
frequency = "20 Hz"
[acquisition]
sample_rate = "51.2 kHz"
settle = "0.9 s"
duration = "1 s"
"""
CLEARANCE_MM = 0.127
HIDDEN_MM = (0.07, -0.045)
CENTRED_SHARE = 0.05


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("swept")
    (folder / "sweep.toml").write_text(SWEEP)
    (folder / "shaker.toml").write_text(SHAKER)
    return folder


@pytest.fixture(scope="module")
def swept(folder: Path) -> tuple[Ended, Ended]:
    """A sweep that is interrupted in its second point, and called again."""
    arguments = ("sweep", folder / "sweep.toml", "--out", folder / "swept")
    with command(*arguments) as first:
        first.await_line("point 2 of 3")
        first.await_line("recording")
        first.signal(signal.SIGINT)
        return first.end(), rattle(*arguments)


@pytest.fixture(scope="module")
def centred(folder: Path) -> list[Ended]:
    """Two beams that rest off centre to either side, centred at the same time."""
    with ExitStack() as stack:
        started = []
        for number, hidden in enumerate(HIDDEN_MM):
            bench = write_bench(
                folder / f"bench{number}.toml",
                emulation=f'[emulation]\nseed = {number}\nrest_offset = "{hidden} mm"',
            )
            out = folder / f"centred{number}.toml"
            arguments = (
                "centre",
                folder / "shaker.toml",
                "--bench",
                bench,
                "-o",
                out,
                "--json",
                "--runs",
                folder / "centrings",
            )
            started.append(stack.enter_context(command(*arguments)))
        return [each.end() for each in started]


def test_a_sweep_goes_on_at_the_first_point_that_is_not_done(
    swept: tuple[Ended, Ended], folder: Path
) -> None:
    stopped, again = swept
    assert (stopped.code, again.code) == (130, 0), stopped.err + again.err
    assert "point 2: stopped: stopped by a person; comes again" in again.out
    assert "\npoint 1 of 3" not in again.out
    (row,) = (
        line.split() for line in stopped.out.splitlines() if line.startswith("2 ") and "stopped" in line
    )
    assert (folder / "swept" / row[-1]).is_file()  # what was recorded of it
    points = json.loads((folder / "swept" / "sweep.json").read_text())["points"]
    assert [points[number]["outcome"] for number in "123"] == ["done"] * 3
    assert len(list((folder / "swept").glob("point-0001/*.mcap"))) == 1
    assert len(list((folder / "swept").glob("point-0002/*.mcap"))) == 2


def test_a_sweep_ends_with_a_table_of_its_points_and_a_page(swept: tuple[Ended, Ended], folder: Path) -> None:
    lines = [line.split() for line in swept[1].out.splitlines()]
    points = json.loads((folder / "swept" / "sweep.json").read_text())["points"]
    for number in "123":
        (row,) = (each for each in lines if each[:1] == [number] and "done" in each)
        assert row[-1] == points[number]["log"]
        assert float(row[-3]) == pytest.approx(HERTZ[int(number) - 1], rel=2e-4)
    assert (folder / "swept" / "sweep.html").is_file()


@pytest.mark.parametrize("number", [1, 2, 3])
def test_each_point_has_its_frequency_its_impacts_and_one_log(
    swept: tuple[Ended, Ended], folder: Path, number: int
) -> None:
    point = json.loads((folder / "swept" / "sweep.json").read_text())["points"][str(number)]
    log = folder / "swept" / point["log"]
    assert verify_log(log).sound
    with LogReader(log) as reader:
        drive = np.concatenate([block.values for _, block in reader.blocks("measured", ["drive.force"])])
        predicted = sum(len(block) for _, block in reader.blocks("predicted", ["drive.force"]))
    # 5 impacts come within 3 cycles; 20 s were the longest
    assert 0.1 < len(drive) / 51_200 < 2.0
    assert predicted == len(drive)
    assert point["impacts"] >= 5
    # the noise of a tenth of a second leaves 1e-5
    assert fit_sine(drive, 51_200.0, HERTZ[number - 1]).frequency == pytest.approx(
        HERTZ[number - 1], rel=2e-4
    )


def test_the_drive_comes_to_a_point_through_those_before_it(swept: tuple[Ended, Ended], folder: Path) -> None:
    points = json.loads((folder / "swept" / "sweep.json").read_text())["points"]
    told = []
    for number in "123":
        with LogReader(folder / "swept" / points[number]["log"]) as reader:
            told.append([event.text for event in reader.events() if event.code == "drive.path"])
    first, second = "frequency 20, amplitude 9, offset 0", "frequency 20.6, amplitude 9, offset 0"
    came = "came without a rest through"
    assert told == [[], [f"{came} {first}"], [f"{came} {first}; {second}"]]


@pytest.mark.parametrize("number", [0, 1])
def test_a_beam_with_a_hidden_rest_position_is_centred(
    centred: list[Ended], folder: Path, number: int
) -> None:
    answer = centred[number]
    assert answer.code == 0, answer.err
    found = json.loads(answer.out)
    scenario = load_scenario(folder / f"centred{number}.toml")
    assert scenario.drive.offset == pytest.approx(found["offset_n"], abs=1e-5)
    # with that offset the tip stands where its stiffness of 2073 N/m at the drive point puts it
    pushed_mm = 1e3 * found["offset_n"] * 4.824e-4
    assert abs(HIDDEN_MM[number] + pushed_mm) < CENTRED_SHARE * CLEARANCE_MM
    assert scenario.model["rest_offset"] * 1e3 == pytest.approx(
        HIDDEN_MM[number], abs=CENTRED_SHARE * CLEARANCE_MM
    )
    assert found["share_of_clearance"] <= 0.02


@pytest.mark.parametrize("number", [0, 1])
def test_what_centring_found_can_be_found_again_in_its_log(
    centred: list[Ended], folder: Path, number: int
) -> None:
    found = json.loads(centred[number].out)
    log = Path(found["log"])
    assert log.parent == folder / "centrings"
    assert verify_log(log).sound
    with LogReader(log) as reader:
        forces = [reader.series("measured", f"contact.force_{side}").values for side in ("upper", "lower")]
        record = {name: json.loads(text) for name, text in reader.metadata["centring"].items()}
        events = [event.text for event in reader.events() if event.code == "centring.offset"]
    result, offsets = record["result"], record["offsets"]
    assert result["offset"] == found["offset_n"]
    assert len(events) == len(offsets) == result["probes"]
    for probe in offsets:
        upper, lower = (force[probe["first_sample"] : probe["end_sample"]] for force in forces)
        again = what_is_touched(upper, lower, 51_200.0, result["sine_hz"], probe["amplitude"])
        assert again == probe["touched"]
