"""`rattle.predict`, `run` and `diagnose`: what the commands do, from Python."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rattle
from daq.log.reader import LogReader
from daq.log.records import Event
from rig.library import run as library_run
from rig.library.diagnosis import Diagnosis
from rig.library.run import Callbacks, _told
from rig.stream import Block
from tests.daq.log.logs import block
from tests.end_to_end.files import write_scenario
from tests.rig.commands.cli import Call, caller
from tests.rig.session.test_stops import InTurn, in_turn

__all__ = ["in_turn"]

EVENT = Event(0, "info", "rig", "drive.on", "9 N")
GAIN = {"name": "sensor_gain", "parameters": {"channel": "yoke.force", "gain": 1.5}}


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    return caller(monkeypatch, capfd)


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return write_scenario(tmp_path / "s.toml", settle_s=0.0, duration_s=0.05)


def test_a_prediction_is_that_of_the_command(call: Call, scenario: Path, tmp_path: Path) -> None:
    effects = tmp_path / "effects.json"
    effects.write_text(json.dumps([GAIN]))
    asked = ("--effects", effects, "--seed", 3, "--out", tmp_path / "twin.mcap")
    assert call("predict", scenario, *asked).code == 0
    found = [rattle.predict(scenario, each, seed=3) for each in (effects, [GAIN])]
    with LogReader(tmp_path / "twin.mcap") as log:
        for name, wanted in log.table("predicted").items():
            for each in found:
                assert np.array_equal(each[name].values, wanted.values)
    assert rattle.predict(scenario, out=tmp_path / "kept.mcap").path == tmp_path / "kept.mcap"
    assert (tmp_path / "kept.mcap").is_file()


def test_an_effect_and_a_setting_change_what_is_predicted(scenario: Path) -> None:
    nominal, gained = (rattle.predict(scenario, each)["yoke.force"].values for each in (None, [GAIN]))
    assert np.allclose(gained, 1.5 * nominal, rtol=1e-5)
    other = rattle.predict(scenario, settings={"acquisition.duration": "0.1 s", "drive.frequency": "30 Hz"})
    assert len(other["yoke.force"]) == 2 * len(nominal)
    assert 'frequency = "30 Hz"' in other.scenario


@pytest.mark.parametrize(
    ("effects", "settings", "words"),
    [
        ([{"name": "sensor_gian"}], None, r"^effects:\n.*did you mean sensor_gain"),
        (GAIN, None, r"^effects:\n.*a list such as"),
        ([{"name": "clearance", "parameters": {"scale": object}}], None, r"scale = .*<class 'object'>"),
        ([{"name": "clearance", "parameters": {"scale": np.float32(99)}}], None, r"scale = 99"),
        (None, {"drive.frequenzy": "3 Hz"}, "did you mean drive.frequency"),
        ("gone.json", None, r"gone\.json"),
    ],
)
def test_what_is_wrong_is_told_as_the_command_does(
    scenario: Path, effects: object, settings: dict[str, object] | None, words: str
) -> None:
    with pytest.raises(rattle.RattleError, match=words):
        rattle.predict(scenario, effects, settings=settings)  # type: ignore[arg-type]
    with pytest.raises(rattle.RattleError, match="at least"):
        rattle.diagnose([])


def test_where_it_goes_is_tried_before_anything_is_read(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("mine")
    for work, unread in ((rattle.run, "not read.toml"), (rattle.diagnose, "not read.mcap")):
        with pytest.raises(rattle.RattleError, match=r"runs is a file; name a folder"):
            work(unread, out=tmp_path / "runs" / "deeper")
    for out, words in (
        (tmp_path / "runs", "runs is there already; remove it or name another, nothing was predicted"),
        (tmp_path / "no" / "twin.mcap", "no: no such folder; nothing was predicted"),
        (Path("/proc/self/twin.mcap"), "cannot write to /proc/self"),
    ):
        with pytest.raises(rattle.RattleError, match=words):
            rattle.predict("not read.toml", out=out)


def test_who_is_called_back_holds_nothing_up_and_hears_all(recwarn: pytest.WarningsRecorder) -> None:
    heard: list[object] = []
    said = Callbacks(lambda origin, each: heard.append((origin, each.first_sample)), heard.append)
    with _told(said) as give:
        give(Block("measured", block(0)))
        give(EVENT)
        give(Block("predicted", block(1)))
    assert heard == [("measured", 0), EVENT, ("predicted", 100)]
    assert not recwarn


def told(callbacks: Callbacks, first: threading.Event, then: Callable[[], object], count: int) -> None:
    """Give one event, wait until it is being told, give the others, and let go."""
    with _told(callbacks) as give:
        give(EVENT)
        assert first.wait(10.0)
        for _ in range(count - 1):
            give(EVENT)
        then()


def test_a_callback_that_hangs_loses_what_comes_and_the_run_goes_on() -> None:
    begun, go_on = threading.Event(), threading.Event()

    def hanging(_: Event) -> None:
        begun.set()
        go_on.wait(10.0)

    with pytest.warns(RuntimeWarning, match="callbacks were too slow: 903 records passed them by"):
        told(Callbacks(on_event=hanging), begun, go_on.set, 5000)


def test_a_callback_that_does_not_return_holds_nothing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library_run, "_PATIENCE_S", 0.01)
    begun, go_on = threading.Event(), threading.Event()

    def hanging(_: Event) -> None:
        begun.set()
        go_on.wait(10.0)

    with pytest.warns(RuntimeWarning, match="a callback does not return"):
        told(Callbacks(on_event=hanging), begun, int, 2)
    go_on.set()
    (thread,) = (each for each in threading.enumerate() if each.name == "callbacks")
    thread.join(10.0)


def test_a_callback_that_raises_is_not_called_again_and_the_run_goes_on() -> None:
    calls, begun = list[Event](), threading.Event()

    def raising(event: Event) -> None:
        calls.append(event)
        begun.set()
        raise ValueError("no")

    with pytest.warns(RuntimeWarning, match="a callback raised ValueError: no; it was not called again"):
        told(Callbacks(on_event=raising), begun, int, 3)
    assert calls == [EVENT]


def test_a_run_gives_its_log_and_calls_back(in_turn: InTurn, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a rig that is made up, so that it takes no time; the script below is on the emulated bench."""
    rig, seen = in_turn.rig, list[str]()
    monkeypatch.setattr(library_run, "connect", in_turn.connect)
    scenario = rig.folder / "s.toml"
    scenario.write_text(rig.scenario.text)
    log = rattle.run(
        scenario,
        out=rig.folder / "runs",
        settings={"acquisition.settle": "0 s"},
        on_block=lambda origin, block: seen.append(f"{origin} {block.channel}"),
        until=lambda: len(seen) > 20,
        quiet=True,
    )
    assert log.path.parent == rig.folder / "runs"
    assert log.complete
    assert f"measured {next(iter(log.measured))}" in seen
    assert 0.1 < len(log["drive.force"]) / log["drive.force"].sample_rate < 20.0
    assert "record.end" in [event.code for event in log.events]
    assert rig.told()[-1] == "close"


@pytest.mark.long
def test_a_script_of_a_few_lines_runs_a_rig(tmp_path: Path) -> None:
    """Without a guard on its name, though processes start; what comes is called back."""
    scenario = write_scenario(tmp_path / "s.toml", duration_s=60.0)
    script = tmp_path / "script.py"
    script.write_text(f"""\
import rattle
seen, codes = [], []
log = rattle.run({str(scenario)!r}, out={str(tmp_path)!r}, quiet=True,
                 on_block=lambda origin, block: seen.append((origin, block.channel)),
                 on_event=lambda event: codes.append(event.code), until=lambda: len(seen) > 40)
print(log.path, len(log["drive.force"]) / 51200, "record.end" in codes)
""")
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=100)  # noqa: S603
    assert ended.returncode == 0, ended.stderr
    path, seconds, told = ended.stdout.split()
    assert 0.3 < float(seconds) < 5.0
    assert told == "True"
    assert Path(path).is_file()


def test_a_diagnosis_is_shown_and_handed_on(tmp_path: Path) -> None:
    document = {
        "verdict": "effect",
        "verdict_probability": {"none": 0.01, "effect": 0.98, "unknown": 0.01},
        "gap": {"before": 7.0, "after": 1.5, "by_channel": {"yoke.force": 9.0, "drive.force": None}},
        "effects": [{"name": "sensor_gain", "probability": 0.96, "present": 0.98, "gap_after": 1.5}],
        "selected": ["sensor_gain"],
        "contrasts": [{"channel": "yoke.force", "what": "peak", "measured": 9.0, "runner_up": 7.0}],
        "typical_cycle": [
            {"channel": "yoke.force", "unit": "N"}
            | {whose: {"phase": [0.0, 0.5], "values": [1.0, 2.0]} for whose in ("measured", "nominal")}
        ],
    }
    found = Diagnosis(document, tmp_path / "report.html", [GAIN], None)
    assert repr(found) == "<Diagnosis: sensor_gain, gap 7 -> 1.5>"
    assert "98.0%" in found._repr_html_()
    assert (found.verdict, found.probability["none"], found.effects) == ("effect", 0.01, [GAIN])
    assert found.to_pandas().loc["sensor_gain", "gap_after"] == 1.5
    assert list(found.plot().data[0].y) == ["yoke.force"]
    assert found.contrasts().loc[0, "runner_up"] == 7.0
    assert [line.name for line in found.plot_cycle().data] == ["measured", "nominal"]
