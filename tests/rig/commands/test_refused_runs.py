"""What is wrong before a run is said in full, with what to check, and nothing has moved."""

from __future__ import annotations

import os
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.errors import RattleError
from drivers.scpi.emulator.process import SourceSetup, start_function_generator
from rig.session.run import RunRequest
from tests.end_to_end.files import write_bench, write_scenario
from tests.rig.commands.cli import Call

SCENARIOS = Path(__file__).parents[3] / "scenarios"
CRANK = SCENARIOS / "planar_slider_crank.toml"
CRANK_BENCH = SCENARIOS / "crank_bench.example.toml"


@pytest.fixture
def nobody() -> Iterator[int]:
    """A port of this machine where nobody listens for as long as the test lasts."""
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield held.getsockname()[1]


def test_every_fault_of_a_scenario_is_listed_at_once(call: Call, tmp_path: Path) -> None:
    (tmp_path / "wrong.toml").write_text("""\
name = "wrong"
rig = "impact_beam"
[drive]
frequency = "20 N"
amplitude = "-9 N"
speed = 3
[acquisition]
sample_rate = "0 Hz"
duration = "1 s"
""")
    answer = call("run", tmp_path / "wrong.toml", "--out", tmp_path / "runs")
    assert answer.code == 2
    for key in ("drive.frequency", "drive.amplitude", "drive.speed", "acquisition.sample_rate"):
        assert key in answer.err
    assert "starting" not in answer.out
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("command", ["run", "sweep", "dwell"])
@pytest.mark.parametrize("deep", ["", "deep/er"])
def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_read(
    call: Call, tmp_path: Path, command: str, deep: str
) -> None:
    (tmp_path / "runs").write_text("mine")
    more = ["--speeds", "60 rpm"] if command == "dwell" else []
    answer = call(command, "not read.toml", *more, "--out", tmp_path / "runs" / deep)
    assert answer.code == 2
    assert f"'--out': {tmp_path / 'runs'} is a file; name a folder" in answer.err
    assert (tmp_path / "runs").read_text() == "mine"


def test_a_folder_on_a_disk_that_takes_nothing_is_refused(call: Call) -> None:
    answer = call("run", "not read.toml", "--out", "/proc/self")
    assert answer.code == 2
    assert "cannot write to /proc/self: " in answer.err


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (
            ("--set", "drive.frequenzy=21 Hz"),
            'drive.frequenzy = "21 Hz": unknown key; did you mean drive.frequency?',
        ),
        (("--set", "drve.frequency=21 Hz"), "did you mean drive?"),
        (("--set", "drive=21"), "drive = 21: "),
        (("--set", "drive.frequency=21 N"), 'drive.frequency = "21 N": '),
        (("--set", "limits.contact.force_uper.abort=9 N"), "did you mean contact.force_upper?"),
        (("--set", "drive.frequency"), "--set drive.frequency: KEY=VALUE"),
        (("--set", "=21 Hz"), "--set =21 Hz: KEY=VALUE"),
        (
            ("--set", "drive.frequency=21 Hz", "--set", "drive.frequency=22 Hz"),
            "drive.frequency has two values, 21 Hz and 22 Hz; name one",
        ),
        (
            ("--set", "acquisition.duration=2 s", "--duration", "3 s"),
            "acquisition.duration has two values, 2 s and 3 s; name one",
        ),
        (
            ("--note", "operator=Ada", "--set", "notes.operator=Bert"),
            "notes.operator has two values, Ada and Bert; name one",
        ),
        (("--duration", "3 N"), 'acquisition.duration = "3 N": '),
        (("--duration", "0", "--until-stopped"), "acquisition.duration = 0: "),
    ],
)
def test_a_setting_that_cannot_be_is_refused_with_what_may_stand_there(
    call: Call, tmp_path: Path, setting: tuple[str, ...], words: str
) -> None:
    file = write_scenario(tmp_path / "s.toml")
    answer = call("run", file, *setting, "--out", tmp_path / "runs")
    assert answer.code == 2
    assert words in answer.err
    assert not (tmp_path / "runs").exists()


NOTED = {
    "run": ("impact_beam.toml", "--out"),
    "sweep": ("beam_frequency.sweep.toml", "--out"),
    "dwell": ("planar_slider_crank.toml", "--speeds", "60 rpm", "--out"),
    "centre": ("impact_beam_shaker.toml", "--runs"),
}


@pytest.mark.parametrize("command", NOTED)
@pytest.mark.parametrize(
    ("notes", "told"),
    [
        (["operator"], "KEY=TEXT"),
        (["operator="], "KEY=TEXT"),
        (["a.b=c"], "KEY=TEXT"),
        (["operator=Ada", "operator=Bert"], "notes.operator has two values, Ada and Bert; name one"),
        (["my key=c"], "a key of letters, digits"),
    ],
)
def test_a_note_that_cannot_be_is_refused(
    call: Call, tmp_path: Path, command: str, notes: list[str], told: str
) -> None:
    options = [part for each in notes for part in ("--note", each)]
    file, *more = NOTED[command]
    answer = call(command, SCENARIOS / file, *options, *more, tmp_path / "runs")
    assert answer.code == 2
    assert told in answer.err


@pytest.mark.parametrize("typed", ["", "\n"])
def test_a_run_that_nobody_can_end_is_refused(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, typed: str
) -> None:
    (tmp_path / "typed").write_text(typed)
    with (tmp_path / "typed").open() as there:
        monkeypatch.setattr("sys.stdin", there)
        file = write_scenario(tmp_path / "s.toml")
        answer = call("run", file, "--until-stopped", "--out", tmp_path / "runs")
    assert answer.code == 2
    assert "--until-stopped: standard input is at its end" in answer.err
    assert "connecting" not in answer.out
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("asked", "open_ended"),
    [((), True), (("--duration", "20 s"), False), (("--set", "acquisition.duration=20 s"), False)],
)
def test_until_stopped_lasts_as_long_as_a_person_says_at_most(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: tuple[str, ...], open_ended: bool
) -> None:
    wanted: list[RunRequest] = []

    def refused(request: RunRequest, *_: object) -> Path:
        wanted.append(request)
        raise RattleError("not now")

    monkeypatch.setattr("rig.session.run.run_scenario", refused)
    reading, writing = os.pipe()
    with open(reading) as there, open(writing, "w"):
        monkeypatch.setattr("sys.stdin", there)
        file = write_scenario(tmp_path / "s.toml")
        assert call("run", file, "--until-stopped", *asked, "--out", tmp_path / "runs").code == 1
    (request,) = wanted
    assert request.open_ended == open_ended
    assert (request.scenario.acquisition.duration == 20.0) != open_ended


def test_every_fault_of_a_bench_is_listed_at_once(call: Call, tmp_path: Path) -> None:
    bench = write_bench(tmp_path / "bench.toml")
    text = bench.read_text().replace('"3.6 N/V"', '"0 N/V"').replace('kind = "voltage"', 'kind = "sound"')
    bench.write_text(text)
    answer = call("run", write_scenario(tmp_path / "s.toml"), "--bench", bench, "--out", tmp_path / "runs")
    assert answer.code == 2
    assert "force_per_volt" in answer.err
    assert "kind" in answer.err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("command", ["run", "check"])
def test_what_the_twin_refuses_is_told_before_anything_is_connected(
    call: Call, tmp_path: Path, command: str
) -> None:
    text = (SCENARIOS / "spatial_slider_crank.toml").read_text()
    (tmp_path / "s.toml").write_text(text.replace("[model]\n", "[model]\nrod_modes = 3\n"))
    bench = tmp_path / "bench.toml"
    bench.write_text("[inverter]\nemulated = true\n[daq_card]\nemulated = true\n")
    answer = call(command, tmp_path / "s.toml", "--bench", bench)
    assert answer.code == 2
    assert "rod_modes" in answer.err
    assert "connecting" not in answer.out


def test_a_drive_above_the_benchs_limit_is_refused(call: Call, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "s.toml", amplitude_n=12.5)
    answer = call("run", scenario, "--out", tmp_path / "runs")
    assert answer.code == 2
    assert "drive.amplitude = 12.5 N" in answer.err
    assert "12 N (signal_generator.maximum_amplitude)" in answer.err


def test_absent_instruments_are_all_named_with_what_to_check(call: Call, tmp_path: Path, nobody: int) -> None:
    resource = f"TCPIP::127.0.0.1::{nobody}::SOCKET"
    bench = write_bench(tmp_path / "bench.toml", resource, f"127.0.0.1:{nobody}")
    answer = call("run", write_scenario(tmp_path / "s.toml"), "--bench", bench, "--out", tmp_path / "runs")
    assert answer.code == 1
    generator, card = answer.err.strip().splitlines()[-2:]
    assert f"signal generator at {resource}: nobody answers" in generator
    assert "Check cable, power and the resource string in the bench file" in generator
    assert f"127.0.0.1:{nobody}" in card
    assert "Check " in card
    assert not (tmp_path / "runs").exists()


def test_another_model_is_named_and_not_driven(call: Call, tmp_path: Path, nobody: int) -> None:
    setup = SourceSetup(identity="HEWLETT-PACKARD,34401A,0,11-5-2")
    with start_function_generator(setup=setup) as generator:
        bench = write_bench(tmp_path / "bench.toml", generator.address, f"127.0.0.1:{nobody}")
        answer = call("run", write_scenario(tmp_path / "s.toml"), "--bench", bench, "--out", tmp_path / "r")
    assert answer.code == 1
    assert f"signal generator at {generator.address}" in answer.err
    assert "34401A" in answer.err
    assert "Check the resource string in the bench file" in answer.err


def test_one_present_and_one_absent_names_the_absent_alone(call: Call, tmp_path: Path, nobody: int) -> None:
    """An error left in the generator's queue by somebody else is nobody's fault now."""
    with start_function_generator(setup=SourceSetup(pending_errors=(-113, -222))) as generator:
        bench = write_bench(tmp_path / "bench.toml", generator.address, f"127.0.0.1:{nobody}")
        answer = call("run", write_scenario(tmp_path / "s.toml"), "--bench", bench, "--out", tmp_path / "r")
    assert answer.code == 1
    assert "signal generator" not in answer.err
    assert f"127.0.0.1:{nobody}" in answer.err


@pytest.mark.parametrize("command", ["run", "emulate"])
def test_a_crank_on_the_bench_of_a_beam_is_refused(call: Call, tmp_path: Path, command: str) -> None:
    bench = write_bench(tmp_path / "bench.toml")
    out = ["--out", tmp_path / "runs"] if command == "run" else []
    answer = call(command, CRANK, "--bench", bench, *out)
    assert answer.code == 2
    assert "signal_generator = {...}: none: the planar_slider_crank is driven by [inverter]" in answer.err
    assert "starting" not in answer.out
    assert not (tmp_path / "runs").exists()


def test_faults_of_a_cranks_scenario_and_of_its_bench_are_told_together(call: Call, tmp_path: Path) -> None:
    scenario = tmp_path / "crank.toml"
    scenario.write_text(CRANK.read_text().replace('"200 rpm"', '"200 Hz"'))
    bench = tmp_path / "bench.toml"
    bench.write_text("[inverter]\nemulated = true\nstation = 300\n")
    answer = call("run", scenario, "--bench", bench, "--out", tmp_path / "runs")
    assert answer.code == 2
    assert "drive.speed" in answer.err
    assert "inverter.station = 300" in answer.err


def test_absent_instruments_of_a_crank_are_all_named(call: Call, tmp_path: Path, nobody: int) -> None:
    bench = tmp_path / "bench.toml"
    text = CRANK_BENCH.read_text().replace("/dev/ttyUSB1", f"socket://127.0.0.1:{nobody}")
    text = text.replace("port = 29536", f"port = {nobody}").replace(
        "valid_until = 2027", "valid_until = 2096"
    )
    bench.write_text(text.replace("[daq_card]\n", f'[daq_card]\ngrpc = "127.0.0.1:{nobody}"\n', 1))
    answer = call("run", CRANK, "--bench", bench, "--out", tmp_path / "runs")
    assert answer.code == 1
    inverter, card, encoder = answer.err.strip().splitlines()[-3:]
    assert f"inverter at socket://127.0.0.1:{nobody}: " in inverter
    assert f"127.0.0.1:{nobody}" in card
    assert "encoder at node 7 on socketcand" in encoder
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "gigabytes"),
    [
        (("run", SCENARIOS / "impact_beam.toml", "--out"), 1.0),
        (("dwell", CRANK, "--speeds", ", ".join(["60 rpm"] * 50), "--each", "600 s", "--out"), 3.0),
        (("centre", SCENARIOS / "impact_beam_shaker.toml", "--runs"), 1.0),
        (("sweep", SCENARIOS / "beam_frequency.sweep.toml", "--out"), 1.0),
    ],
)
def test_nothing_is_recorded_where_the_disk_has_no_room_for_it(
    call: Call,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str | Path, ...],
    gigabytes: float,
) -> None:
    left = shutil.disk_usage(tmp_path)._replace(free=round(gigabytes * 1e9))
    monkeypatch.setattr(shutil, "disk_usage", lambda _: left)
    answer = call(*arguments, tmp_path / "runs")
    assert (answer.code, (tmp_path / "runs").exists()) == (2, False)
    assert f"free disk space = {gigabytes:.1f} GB" in answer.err
