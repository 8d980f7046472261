"""`rattle sweep` and `rattle centre` before anything moves: what they list and what they refuse."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.errors import RattleError
from rig.files.scenario import Scenario, parse_scenario
from rig.session import centring_run
from tests.end_to_end.files import write_bench, write_scenario
from tests.rig.commands.cli import Call
from tests.rig.files.test_model_file import TEXT as MODEL

SCENARIOS = Path(__file__).parents[3] / "scenarios"
HIGH = """\
[sweep]
name = "too high"
scenario = "s.toml"
[axes]
"drive.amplitude" = { from = "6 N", to = "14 N", steps = 5 }
"model.clearance" = ["0.1 mm", "0.2 mm"]
"""


@pytest.fixture
def too_high(tmp_path: Path) -> Path:
    limits = '[limits."contact.force_upper"]\nabort = "500 N"'
    write_scenario(tmp_path / "s.toml", limits=limits)
    (tmp_path / "sweep.toml").write_text(HIGH)
    return tmp_path / "sweep.toml"


@pytest.mark.parametrize("name", ["beam_frequency", "crank_speed"])
def test_an_example_is_listed_and_nothing_moves(call: Call, tmp_path: Path, name: str) -> None:
    file = SCENARIOS / f"{name}.sweep.toml"
    assert call("check", file).code == 0
    answer = call("sweep", file, "--dry", "--out", tmp_path / "swept")
    assert answer.code == 0, answer.err
    assert "2 moves by hand" in answer.out
    assert "BY HAND model.clearance" in answer.out
    assert ("shaft within 5% of its speed" in answer.out) == (name == "crank_speed")
    assert answer.out.splitlines()[-1] == "nothing has moved"
    assert not (tmp_path / "swept").exists()


@pytest.mark.parametrize("arguments", [["--dry"], []])
def test_what_no_point_may_do_is_refused_all_at_once(
    call: Call, too_high: Path, arguments: list[str]
) -> None:
    answer = call("sweep", too_high, "--out", too_high.parent / "swept", *arguments)
    assert answer.code == 2
    assert "points 9-10: drive.amplitude = 14 N: amplitude and offset together up to 12 N" in answer.err
    assert 'points 1-10: limits."contact.force_upper".abort = 500 N: below 200 N' in answer.err
    assert not (too_high.parent / "swept").exists()


def test_a_model_of_another_rig_is_refused_before_anything_moves(call: Call, tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    arguments = ("--dry", "--live", "--out", tmp_path / "swept", "--model", tmp_path / "model.toml")
    assert call("sweep", SCENARIOS / "beam_frequency.sweep.toml", *arguments).code == 0
    answer = call("sweep", SCENARIOS / "crank_speed.sweep.toml", *arguments)
    assert answer.code == 2
    assert "impact_beam" in answer.err


@pytest.mark.parametrize(
    ("command", "file", "more"),
    [("sweep", "beam_frequency.sweep.toml", ("--dry",)), ("run", "impact_beam.toml", ())],
)
def test_a_model_of_another_specimen_is_refused_before_anything_moves(
    call: Call, tmp_path: Path, command: str, file: str, more: tuple[str, ...]
) -> None:
    model, out = tmp_path / "model.toml", tmp_path / "out"
    model.write_text(f'specimen = "steel 3"\n{MODEL}')
    given = ("--note", "specimen=steel 7", "--out", out, "--model", model)
    answer = call(command, SCENARIOS / file, *more, *given)
    assert answer.code == 2
    assert 'specimen = "steel 3": "steel 7", which scenario or runs are of' in answer.err
    assert "connecting" not in answer.out
    assert not out.exists()


def test_a_crank_above_its_maximum_speed_is_refused(call: Call, tmp_path: Path) -> None:
    text = (SCENARIOS / "crank_speed.sweep.toml").read_text().replace('to = "240 rpm"', 'to = "500 rpm"')
    (tmp_path / "fast.toml").write_text(text)
    answer = call("sweep", tmp_path / "fast.toml", "--dry")
    assert answer.code == 2
    assert "points 4, 8: drive.speed = 500 rpm" in answer.err


def test_a_rehearsal_is_refused_on_real_instruments(call: Call, tmp_path: Path) -> None:
    bench = write_bench(tmp_path / "bench.toml", "TCPIP::127.0.0.1::5025::SOCKET", "127.0.0.1:31763")
    file = SCENARIOS / "beam_frequency.sweep.toml"
    answer = call("sweep", file, "--bench", bench, "--yes", "--out", tmp_path / "swept")
    assert answer.code == 2
    assert "--yes = signal_generator, daq_card: not with real instruments" in answer.err


def test_a_point_that_is_none_cannot_be_repeated(call: Call, tmp_path: Path) -> None:
    answer = call("sweep", SCENARIOS / "beam_frequency.sweep.toml", "--again", "99", "--out", tmp_path / "s")
    assert answer.code == 2
    assert "--again = 99: points 1 to 14" in answer.err


def test_a_beam_that_no_offset_holds_is_not_centred(call: Call, tmp_path: Path) -> None:
    answer = call("centre", SCENARIOS / "impact_beam.toml", "-o", tmp_path / "centred.toml")
    assert answer.code == 2
    assert "rests as softly as its flexure" in answer.err
    assert "starting" not in answer.out
    sweep = SCENARIOS / "beam_frequency.sweep.toml"
    text = sweep.read_text().replace(
        '"impact_beam.toml"', f'"{SCENARIOS / "impact_beam.toml"}"\ncentre = true'
    )
    (tmp_path / "sweep.toml").write_text(text)
    answer = call("sweep", tmp_path / "sweep.toml", "--dry")
    assert answer.code == 2
    assert "points 1-7: model = 2.96 N/m" in answer.err


def test_a_scenario_that_is_there_is_not_written_over(call: Call, tmp_path: Path) -> None:
    (tmp_path / "there.toml").write_text("mine")
    answer = call("centre", SCENARIOS / "impact_beam_shaker.toml", "-o", tmp_path / "there.toml")
    assert answer.code == 1
    assert "there.toml is there already; name another file with -o" in answer.err
    assert (tmp_path / "there.toml").read_text() == "mine"


def test_a_note_stands_in_the_log_of_a_search_for_the_middle(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted: list[Scenario] = []

    def found(scenario: Scenario, *_: object) -> None:
        wanted.append(scenario)
        raise RattleError("enough")

    monkeypatch.setattr(centring_run, "find_centre", found)
    options = ("--note", "operator=Ada", "-o", tmp_path / "centred.toml", "--runs", tmp_path / "runs")
    assert "enough" in call("centre", SCENARIOS / "impact_beam_shaker.toml", *options).err
    assert [parse_scenario(each.text).notes for each in wanted] == [{"operator": "Ada"}]


@pytest.mark.parametrize("rig", ["planar_slider_crank", "spatial_slider_crank"])
def test_only_the_beam_is_centred(call: Call, tmp_path: Path, rig: str) -> None:
    answer = call("centre", SCENARIOS / f"{rig}.toml", "-o", tmp_path / "centred.toml")
    assert answer.code == 2
    assert "no other rests between two stops" in answer.err


@pytest.mark.parametrize(
    ("place", "says"),
    [('"11 mm"', 'or "drawn"'), ('"middle"', 'or "drawn"'), ("true", 'or "drawn"')],
)
def test_a_hidden_rest_position_is_a_place_or_drawn(
    call: Call, tmp_path: Path, place: str, says: str
) -> None:
    bench = write_bench(tmp_path / "bench.toml", emulation=f"[emulation]\nrest_offset = {place}")
    answer = call("check", bench)
    assert answer.code == 2
    assert says in answer.err
