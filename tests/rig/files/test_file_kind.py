"""A file in the place of another is called by its name, with the command that takes it."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.commands.check import load_any
from rig.files.file_kind import read_file, refuse_other_than_log
from tests.daq.log.logs import write_ramp
from tests.rig.commands.cli import Call, caller
from tests.rig.files.faulty import only_problem

SCENARIOS = Path(__file__).parents[3] / "scenarios"
SCENARIO, BENCH = SCENARIOS / "impact_beam.toml", SCENARIOS / "bench.example.toml"
SWEEP = SCENARIOS / "crank_speed.sweep.toml"


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    return caller(monkeypatch, capfd)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_ramp(tmp_path / "log.mcap")


@pytest.mark.parametrize(
    ("arguments", "file", "said"),
    [
        (["replay", SCENARIO], SCENARIO, "(a scenario): a log is taken here; a scenario by: rattle run"),
        (["verify", BENCH], BENCH, "(a bench): a log is taken here; a bench by: rattle run"),
        (["gap", SWEEP, SWEEP], SWEEP, "(a sweep): a log is taken here"),
        (["run", SWEEP], SWEEP, f"(a sweep): a scenario is taken here; a sweep by: rattle sweep {SWEEP}"),
        (["predict", SWEEP, "--out", "x"], SWEEP, "(a sweep): a scenario is taken here"),
        (["run", BENCH], BENCH, f"rattle run SCENARIO.toml --bench {BENCH}"),
        (["sweep", SCENARIO], SCENARIO, "(a scenario): a sweep is taken here; a scenario by: rattle run"),
        (["run", SCENARIO, "--bench", SCENARIO], SCENARIO, "(a scenario): a bench is taken here"),
        (["run", SCENARIO, "--model", BENCH], BENCH, "(a bench): a model is taken here"),
    ],
)
def test_a_file_in_the_place_of_another_is_named_in_two_lines(
    call: Call, arguments: list[object], file: Path, said: str
) -> None:
    answer = call(*arguments)
    assert answer.code == 2
    first, second = answer.err.splitlines()
    assert first == f"rattle: {file}:"
    assert said in second
    assert not answer.out


def test_scenario_and_bench_in_each_others_place_are_both_named(call: Call) -> None:
    answer = call("run", BENCH, "--bench", SCENARIO)
    assert answer.code == 2
    _, bench, scenario = answer.err.splitlines()
    assert f"{BENCH}: file = (a bench)" in bench
    assert f"{SCENARIO}: file = (a scenario)" in scenario


def test_a_log_is_no_faulty_text(call: Call, log: Path) -> None:
    for arguments in (["run", log], ["run", SCENARIO, "--bench", log], ["sweep", log]):
        answer = call(*arguments)
        assert answer.code == 2
        assert f"is taken here; a log by: rattle replay {log}" in answer.err
    problem = only_problem(lambda: load_any(log), "file")
    assert problem.allowed.startswith("a scenario or a bench or a sweep is taken here")


def test_what_is_no_file_of_rattles_is_no_log_and_says_so_in_plain_words(call: Call, tmp_path: Path) -> None:
    (tmp_path / "not.mcap").write_text("hello")
    answer = call("replay", tmp_path / "not.mcap")
    assert answer.code == 1
    said = f"rattle: {tmp_path / 'not.mcap'}: not a log (it does not begin as an MCAP file does)\n"
    assert answer.err == said


@pytest.mark.parametrize("name", ["gone.mcap", "."])
def test_what_cannot_be_read_is_left_to_who_opens_the_log(tmp_path: Path, name: str) -> None:
    refuse_other_than_log(tmp_path / name)


@pytest.mark.parametrize(
    "text",
    [
        "[daq_card]\n[limits]\n",  # a bench with a table of a scenario: a fault in it, not another file
        "[inverter]\nemulated = true\n[daq_card]\nemulated = true\n[drive]\n",
        "[[[\n",
        "colour = 3\n",
    ],
)
def test_a_fault_makes_no_other_file(text: str, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(text)
    assert read_file(tmp_path / "bench.toml", "bench") == text
