"""A sweep goes on where it was stopped: what is done stays done, failures are named, nothing is set twice."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import re
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from daq.errors import ConfigurationError, DeviceLost, EmergencyStop, InterlockTripped, LogError, RattleError
from rig.files.bench import parse_bench
from rig.files.model_file import parse_model
from rig.files.scenario import Scenario
from rig.live.view import LiveView, Swept
from rig.rigs import RIGS
from rig.session.devices import Standing
from rig.session.pace import Paces
from rig.session.signals import Stopped
from rig.sweep.results import TABLE, points_of
from rig.sweep.state import FILE, CentreState, held, load_state
from tests.rig.files.test_model_file import TEXT as MODEL
from tests.rig.sweep.swept import AXES, SCENARIO, Runs, Trial, parsed

EMBEDDED_BENCH = RIGS["impact_beam"].bench


@pytest.fixture
def trial(tmp_path: Path) -> Trial:
    return Trial(tmp_path / "swept")


def lost() -> DeviceLost:
    return DeviceLost("card", "here", "it went away")


def test_every_point_is_recorded_with_its_own_values_and_stands_in_the_table(trial: Trial) -> None:
    runs = Runs()
    state = trial.call(runs)
    assert runs.points == [1, 2, 3, 4]
    driven = [(each.scenario.model["clearance"], each.scenario.drive.frequency) for each in runs.asked]
    assert driven == [(1e-4, 19.0), (1e-4, 20.0), (2e-4, 19.0), (2e-4, 20.0)]
    assert state.ended("done") == (1, 2, 3, 4)
    rows = list(csv.DictReader((trial.folder / TABLE).read_text().splitlines()))
    assert [row["model.clearance"] for row in rows] == ["0.1 mm", "0.1 mm", "0.2 mm", "0.2 mm"]
    for row in rows:
        assert (trial.folder / row["log"]).is_file()
        # the made-up force has half cycles of 40 N, each with 0.02 N of noise on its peak
        assert float(row["max_mean_n"]) == pytest.approx(40.0, abs=0.1)


def test_a_run_is_asked_to_come_through_the_points_before_it(trial: Trial) -> None:
    trial.sweep = parsed('"drive.frequency" = ["19 Hz", "20 Hz"]', 'up_and_down = ["drive.frequency"]')
    trial.call(runs := Runs())
    assert [[drive.frequency for drive in each.path] for each in runs.asked] == [[], [19.0], [19.0, 20.0]]


def test_the_whole_way_to_a_point_is_centred(trial: Trial) -> None:
    settings = 'centre = true\nup_and_down = ["drive.frequency"]'
    trial.sweep = parsed('"drive.frequency" = ["19 Hz", "20 Hz"]', settings)
    trial.centre = lambda *_: CentreState(0.25, 0.01, -5e-6)
    trial.call(runs := Runs())
    ways = [[*each.path, each.scenario.drive] for each in runs.asked]
    assert [[drive.frequency for drive in way] for way in ways] == [[19.0], [19.0, 20.0], [19.0, 20.0, 19.0]]
    assert {drive.offset for way in ways for drive in way} == {0.25}


def test_all_points_are_recorded_on_one_emulated_rig(trial: Trial) -> None:
    runs = Runs({2: lost()})
    with pytest.raises(DeviceLost, match="went away"):
        trial.call(runs)
    trial.call(runs)
    assert len({each.bench.emulation.seed for each in runs.asked}) == 1
    bench = parse_bench(f"{EMBEDDED_BENCH}\n[emulation]\nseed = 7\n", "bench.toml", Path())
    seeded = Trial(trial.folder.with_name("seeded"), bench=bench)
    seeded.call(runs := Runs())
    assert {each.bench.emulation.seed for each in runs.asked} == {7}


def test_a_complete_sweep_called_again_does_nothing(trial: Trial) -> None:
    trial.call(Runs())
    trial.call(runs := Runs())
    assert runs.points == []


@pytest.mark.parametrize("error", [lost(), Stopped("stopped by a person"), RattleError("anything")])
def test_what_stops_a_sweep_is_no_fault_of_the_point_which_comes_again(
    trial: Trial, error: RattleError
) -> None:
    with pytest.raises(type(error), match=str(error)):
        trial.call(Runs({3: error}))
    assert "points 1-2 of 4" not in trial.said
    trial.call(runs := Runs())
    assert runs.points == [3, 4]
    said = trial.said
    assert "done       points 1-2 of 4" in said
    assert f"point 3: stopped: {error}; comes again" in said


def test_the_power_fails_in_the_middle_of_a_point(trial: Trial) -> None:
    """Nothing of it was written down; half a log lies there."""

    class Power(BaseException):
        pass

    def fails() -> None:
        raise Power

    runs = Runs({2: fails})
    with pytest.raises(Power):
        trial.call(runs)
    trial.call(runs)
    assert runs.points == [1, 2, 2, 3, 4]


def test_an_interlock_ends_the_sweep_and_its_point_is_not_repeated_silently(trial: Trial) -> None:
    with pytest.raises(InterlockTripped, match=r"point 2: interlock: 190 N.* --again 2 repeats it"):
        trial.call(Runs({2: InterlockTripped("interlock: 190 N")}))
    state = trial.call(runs := Runs())
    assert runs.points == [3, 4]
    assert "point 2: interlock: interlock: 190 N; not repeated without --again 2" in trial.said
    assert state.ended("interlock") == (2,)
    assert state.points[2].log is None  # nothing was recorded
    state = trial.call(runs := Runs(), again={2})
    assert runs.points == [2]
    assert state.ended("done") == (1, 2, 3, 4)


def test_what_was_recorded_of_a_point_that_was_stopped_is_told(trial: Trial) -> None:
    def recorded_in_part() -> None:
        folder = trial.folder / "point-0002"
        folder.mkdir(parents=True)
        (folder / "part.mcap").write_bytes(b"")
        raise Stopped("stopped by a person")

    with pytest.raises(Stopped):
        trial.call(Runs({2: recorded_in_part}))
    state = load_state(trial.folder)
    assert state is not None
    assert state.points[2].log == "point-0002/part.mcap"
    first, second = points_of(trial.folder, trial.sweep, state)
    assert (first["point"], first["outcome"], first["settings"]) == (
        1,
        "done",
        dict(trial.sweep.points[0].settings),
    )
    assert (second["outcome"], second["why"]) == ("stopped", "stopped by a person")
    assert second["log"] == str(trial.folder / "point-0002" / "part.mcap")
    assert (first["impacts"], first["counted"]) == (4, None)
    assert "impacts recorded" not in first["figures"]
    whole = dataclasses.replace(state.points[1], impacts=15, figures={"impacts recorded": 17.0})
    [counted, _] = points_of(trial.folder, trial.sweep, state.with_point(1, whole))
    assert (counted["impacts"], counted["counted"], counted["figures"]) == (17, 15, {})


def test_a_point_that_an_emergency_stop_ended_is_done_by_the_next_call(trial: Trial) -> None:
    with pytest.raises(EmergencyStop):
        trial.call(Runs({2: EmergencyStop("port0/line0 of a card", "its line is open", 0.0)}))
    trial.call(runs := Runs())
    assert runs.points == [2, 3, 4]


@pytest.mark.parametrize("code", ["drive.frequency_off", "drive.frequency_unknown", "motor.off_speed"])
def test_a_point_whose_frequency_was_not_held_has_failed_and_the_others_go_on(
    trial: Trial, code: str
) -> None:
    state = trial.call(runs := Runs({2: code}))
    assert runs.points == [1, 2, 3, 4]
    assert state.ended("failed") == (2,)
    assert state.points[2].log is not None
    assert "point 2 failed: drive as it was" in trial.said
    trial.call(runs := Runs())
    assert runs.points == []
    assert "not repeated without --again 2" in trial.said


def test_a_signal_between_two_runs_ends_the_sweep_after_the_point_is_written_down(trial: Trial) -> None:
    with pytest.raises(Stopped, match="stopped by a person"):
        trial.call(runs := Runs({2: lambda: os.kill(os.getpid(), signal.SIGINT)}))
    assert runs.points == [1, 2]
    trial.call(runs := Runs())
    assert runs.points == [3, 4]


class Terminal:
    """Somebody who presses Enter, or leaves."""

    def __init__(self, trial: Trial, monkeypatch: pytest.MonkeyPatch, enters: int = 100) -> None:
        self.asked: list[str] = []
        self._left = enters
        monkeypatch.setattr(trial.screen.console, "input", self._input)

    def _input(self, prompt: str, markup: bool) -> str:
        self.asked.append(prompt)
        self._left -= 1
        if self._left < 0:
            raise EOFError
        return ""


def test_a_move_by_hand_says_what_to_do_waits_and_is_not_repeated(
    trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    person = Terminal(trial, monkeypatch)
    with pytest.raises(DeviceLost, match="went away"):
        trial.call(Runs({2: lost()}), rehearsal=False)
    assert len(person.asked) == 1
    assert "model.clearance -> 0.1 mm: move the two stops" in person.asked[0]
    trial.call(Runs(), rehearsal=False)
    assert len(person.asked) == 2
    assert "model.clearance 0.1 mm -> 0.2 mm" in person.asked[1]
    trial.call(Runs(), again={4}, rehearsal=False)
    assert len(person.asked) == 2
    trial.call(Runs(), again={1}, rehearsal=False)
    assert "model.clearance 0.2 mm -> 0.1 mm" in person.asked[2]
    trial.call(Runs(), again={1}, rehearsal=False, anew=True)
    assert "model.clearance -> 0.1 mm" in person.asked[3]


@pytest.mark.parametrize("centre", [False, True])
def test_points_share_what_is_connected_until_somebody_reaches_into_the_rig(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, centre: bool
) -> None:
    """Or until it is centred, which connects by itself."""
    runs, closed = Runs(), list[int]()
    monkeypatch.setattr(Standing, "close", lambda _: closed.append(len(runs.asked)))
    trial = Trial(tmp_path / "swept", parsed(settings="centre = true" if centre else ""))
    trial.centre = lambda *_: CentreState(0.1, 0.01, -5e-6)
    person = Terminal(trial, monkeypatch)
    trial.call(runs, rehearsal=False)
    assert len(person.asked) == 2
    assert closed == ([0, 0, 2, 2] if centre else [0, 2])
    assert len({id(each.standing) for each in runs.asked}) == 1
    assert runs.asked[0].standing is not None


def test_what_a_point_took_says_how_long_the_others_take(
    trial: Trial, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One before which the rig was connected says it of such ones."""
    monkeypatch.setenv("RATTLE_PACES", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("rig.session.pace._PROJECT", tmp_path)
    trial.screen.paces = Paces()
    trial.sweep = parsed('"drive.frequency" = ["19 Hz", "20 Hz", "21 Hz"]')
    trial.call(Runs())
    told = [line for line in trial.said.splitlines() if line.startswith("point ")]
    assert "(about 30 s left)" in told[0]
    assert "(about 10 s left)" in told[1]
    assert "(about 0 s left)" in told[2]
    trial.folder = tmp_path / "once more"
    trial.call(Runs())
    first = next(line for line in trial.said.splitlines() if line.startswith("point "))
    left = re.search(r"\(about (\d+) s left\)", first)
    assert left is not None, first
    assert int(left[1]) < 10  # as these points took, on a busy machine too; not half a minute as before any


def test_nothing_moves_where_nobody_confirms(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    Terminal(trial, monkeypatch, enters=1)
    runs = Runs()
    with pytest.raises(RattleError, match="nobody is there to confirm"):
        trial.call(runs, rehearsal=False)
    assert runs.points == [1, 2]
    assert (trial.folder / FILE).is_file()


def test_a_move_on_a_real_rig_is_confirmed_at_a_terminal_alone(
    trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = dataclasses.replace(trial.bench.actuator, emulated=False)
    instruments = {**trial.bench.instruments, trial.bench.actuator_table: real}
    trial.bench = dataclasses.replace(trial.bench, instruments=instruments)
    person, runs = Terminal(trial, monkeypatch), Runs()
    with pytest.raises(RattleError, match=r"by hand .* nobody is there to confirm it .*no terminal"):
        trial.call(runs, rehearsal=False)
    assert person.asked == runs.asked == []


def test_every_point_is_shown_in_the_view_and_predicted_by_the_model(trial: Trial) -> None:
    shown: list[Swept] = []
    trial.view = cast(LiveView, SimpleNamespace(offer=shown.append))
    trial.model = parse_model(MODEL, "model.toml", "impact_beam")
    trial.call(runs := Runs())
    assert [each.view for each in runs.asked] == [trial.view] * 4
    assert len(shown) == 4  # after each point what there is of it, of the last one too
    assert None not in shown[-1].plots["largest peak, N"]["measured"]
    assert all(each.model is trial.model for each in runs.asked)
    trial.model = None
    with pytest.raises(ConfigurationError, match=r"model file = .changed since"):
        trial.call(Runs())


@pytest.mark.parametrize("changed", ["sweep", "scenario", "bench"])
def test_a_changed_file_is_told(trial: Trial, changed: str) -> None:
    trial.call(Runs())
    match changed:
        case "sweep":
            trial.sweep = parsed(f"{AXES}\n# a remark")
        case "scenario":
            trial.sweep = parsed(scenario=SCENARIO.replace("9 N", "8 N"))
        case _:
            trial.bench = dataclasses.replace(trial.bench, text=f"{trial.bench.text}\n")
    with pytest.raises(ConfigurationError, match=f"{changed} file = .changed since.*choose another --out"):
        trial.call(Runs())


def test_a_changed_hidden_effect_is_told(tmp_path: Path) -> None:
    (tmp_path / "hidden.json").write_text("[]")
    text = f'{EMBEDDED_BENCH}\n[emulation]\neffects = "hidden.json"\n'
    trial = Trial(tmp_path / "swept", bench=parse_bench(text, "bench.toml", tmp_path))
    trial.call(Runs())
    (tmp_path / "hidden.json").write_text("[ ]")
    with pytest.raises(ConfigurationError, match="effects file"):
        trial.call(Runs())


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"schema": "rattle.sweep/9"}', '{"schema":"rattle.sweep/1"}']
)
def test_a_damaged_state_is_told_and_nothing_is_run(trial: Trial, text: str) -> None:
    trial.folder.mkdir()
    (trial.folder / FILE).write_text(text)
    with pytest.raises(LogError, match=r"sweep\.json is damaged"):
        trial.call(runs := Runs())
    assert runs.points == []


def test_the_state_on_disk_is_never_half(trial: Trial) -> None:
    """At every moment of a sweep at which a run is asked for, the file is whole and says what is done."""
    seen: list[tuple[int, ...]] = []

    def look() -> None:
        state = load_state(trial.folder)
        assert state is not None
        seen.append(state.ended("done"))

    trial.call(Runs(dict.fromkeys((2, 3, 4), look)))
    assert seen == [(1,), (1, 2), (1, 2, 3)]
    assert json.loads((trial.folder / FILE).read_text())["schema"] == "rattle.sweep/1"
    assert not list(trial.folder.glob(".*.new"))


def test_two_sweeps_do_not_share_a_folder(tmp_path: Path) -> None:
    with held(tmp_path), pytest.raises(RattleError, match="another rattle sweep is at work"), held(tmp_path):
        raise AssertionError


def test_impacts_that_were_not_enough_are_told(tmp_path: Path) -> None:
    sweep = parsed('"drive.frequency" = ["20 Hz"]', 'until = { impacts = 15, longest = "2 s" }')
    trial = Trial(tmp_path / "swept", sweep)
    state = trial.call(Runs())
    assert state.points[1].outcome == "done"
    assert state.points[1].impacts == 4  # two cycles of a beam that touches either side once in each
    assert "4 of 15 impacts within 2 s" in trial.said


def test_centring_comes_first_and_after_each_move_by_hand_and_reaches_every_point(tmp_path: Path) -> None:
    asked: list[float] = []

    def centre(scenario: Scenario, *_: object) -> CentreState:
        asked.append(scenario.model["clearance"])
        return CentreState(0.1 * len(asked), 0.01, -5e-6 * len(asked))

    trial = Trial(tmp_path / "swept", parsed(settings="centre = true"), centre=centre)
    with pytest.raises(DeviceLost, match="went away"):
        trial.call(Runs({2: lost()}))
    runs = Runs()
    trial.call(runs)
    assert asked == [1e-4, 2e-4]
    offsets = [(each.scenario.drive.offset, each.scenario.model["rest_offset"]) for each in runs.asked]
    assert offsets == [(0.1, -5e-6), (0.2, -1e-5), (0.2, -1e-5)]
