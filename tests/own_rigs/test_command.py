"""`rattle diagnose --subject` on the rig of the page, on an installed one, and on what is wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import rattle
from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.errors import LogError, RattleError
from daq.log.records import STOPPING, Event
from daq.log.writer import LogWriter
from rig.commands.cli import FAILED, WRONG_USE
from rig.diagnosis import own_rig as diagnosing
from rig.diagnosis.kept import KEEP
from rig.diagnosis.own_rig import OwnRequest, columns_of, diagnose_own
from rig.ensembles import Simulated
from rig.session.progress import Screen, Terminal
from sim_twin.own_rig import Draw, Observed, Subject
from tests.fake_packages import install
from tests.hostile import bounded
from tests.own_rigs.conftest import TIMES, bouncing_ball
from tests.rig.browser import browser_page, faults_of_report, needs_chromium
from tests.rig.commands.cli import Call, caller

CODE = bouncing_ball()


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    return caller(monkeypatch, capfd)


def written(folder: Path, code: str = CODE, drag: float = 0.0) -> tuple[Path, Path]:
    """The rig's file, and four drops of a ball with that much drag, as a table."""
    own, rng = SimpleNamespace(), np.random.default_rng(8)
    names: dict[str, object] = {}
    exec(CODE, names)  # noqa: S102 - it is the page's
    own.simulate = names["simulate"]
    rows = ["drop,time,height"]
    for drop in range(4):
        release = 1.0 + 0.005 * rng.standard_normal()
        p = SimpleNamespace(gravity=9.81, drag=drag, restitution=0.852, scale=1.001, release=release)
        heights = own.simulate(p, {"time": TIMES})["height"] + 0.002 * rng.standard_normal(len(TIMES))
        rows += [f"{drop},{time},{height}" for time, height in zip(TIMES, heights, strict=True)]
    (folder / "my_ball.py").write_text(code)
    (folder / "drops.csv").write_text("\n".join(rows) + "\n")
    return folder / "my_ball.py", folder / "drops.csv"


def test_the_rig_of_the_page_takes_forty_lines_at_most() -> None:
    assert len(CODE.splitlines()) <= 40


@pytest.mark.long
@pytest.mark.timeout(1200)
@needs_chromium
def test_the_rig_of_the_page_is_diagnosed_and_reported(call: Call, folder: Path) -> None:
    rig, drops = written(folder, drag=0.08)
    said = call("diagnose", "--subject", rig, drops, "--out", folder / "answer", "--seeds", 2)
    assert said.code == 0, said.err
    assert re.search(r"1[012] of 12 simulated rigs, most with a cause hidden, were taken for", said.out)
    assert "the same with 2 seeds and with narrower and wider healthy rigs" in said.out
    found = json.loads((folder / "answer" / "diagnosis.json").read_text())
    assert (found["verdict"], found["selected"]) == ("effect", ["drag"])
    low, high = found["effects"][0]["parameters"]["drag"]["ci95"]
    assert low < 0.08 < high
    assert found["gap"]["after"] < 1.3 < 3 < found["gap"]["before"]
    assert [each["selected"] for each in found["by_seed"]] == [["drag"], ["drag"]]
    assert {each["width"]: each["selected"] for each in found["by_width"]} == {0.5: ["drag"], 2.0: ["drag"]}
    again = {each["cause"]: each["found"] for each in found["found_again"]}
    assert again.keys() == {"nothing", "drag", "soft_plate", "wrong_scale"}
    assert min(again.values()) >= 2
    effects = json.loads((folder / "answer" / "effects.json").read_text())
    assert [each["name"] for each in effects] == ["drag"]
    assert faults_of_report(folder / "answer" / "report.html") == []
    with browser_page() as page:
        page.goto((folder / "answer" / "report.html").as_uri())
        page.wait_for_function("[...document.querySelectorAll('.plot')].every(plot => plot.calcdata)")
        assert page.locator(".plot").count() == 2  # the numbers, and where the gap lies
        text = page.inner_text("body")
    assert "comes from drag at the air" in text
    assert f"rattle diagnose --subject {rig} {drops}" in text
    for absent in ("rattle gap", "--budget", "No further run"):
        assert absent not in text


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_an_installed_rig_is_diagnosed_from_python_by_its_name(
    monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    _, drops = written(folder)
    install(monkeypatch, folder, "ball-package", "rattle.subjects", {"ball": "ball_package:SUBJECT"}, CODE)
    found = rattle.diagnose([drops], subject="ball", quiet=True)
    assert found.verdict == "none"
    assert found.document["provenance"]["subject"] == "ball"
    assert found.report.is_file()


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_a_second_look_simulates_hardly_anything_and_says_the_same_until_the_rig_changes(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.delenv(KEEP)
    simulated: list[Draw] = []

    class Counted(Simulated):
        def of(self, subject: Subject, draws: Sequence[Draw]) -> list[Observed]:
            simulated.extend(draws)
            return super().of(subject, draws)

    monkeypatch.setattr(diagnosing, "Simulated", Counted)
    rig, drops = written(folder, drag=0.08)

    def asked(*more: object) -> tuple[dict[str, object], int]:
        simulated.clear()
        options = ("--out", folder / "answer", "--seeds", 1, *more)
        said = call("diagnose", "--subject", rig, drops, *options)
        assert said.code == 0, said.err
        found = json.loads((folder / "answer" / "diagnosis.json").read_text())
        return {name: found[name] for name in ("verdict", "effects", "gap", "by_width")}, len(simulated)

    first, count = asked("--effort", 0.5)
    assert count > 300  # the check's, and of three widths those of a first look and those to judge by
    assert asked("--rigs", 200) == (first, 3)  # by which other processes are looked at, whatever is kept
    assert asked("--effort", 0.5, "--budget", 10) == (first, 3)  # nothing is left that takes time
    rig.write_text(f"{CODE}\n# the same, but who knows\n")
    assert asked("--effort", 0.5) == (first, count)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_a_budget_that_is_too_small_gives_no_answer(folder: Path) -> None:
    rig, drops = written(folder)
    request = OwnRequest(str(rig), [drops], seeds=1, budget_s=0.0)
    with pytest.raises(RattleError, match="give it more time: --budget"):
        diagnose_own(request, folder / "answer", Screen(Terminal(quiet=True)))
    assert not (folder / "answer").exists()


def test_a_subject_that_draws_differently_from_the_same_seed_is_never_used(call: Call, folder: Path) -> None:
    rig, drops = written(folder, CODE.replace("p.release, 0.0", "p.release + np.random.rand(), 0.0"))
    said = call("diagnose", "--subject", rig, drops, "--out", folder / "answer")
    assert said.code == FAILED
    assert "cannot be believed, nothing was diagnosed" in said.err
    assert "the same draw gives other numbers: everything random has to come from draw.seed" in said.err
    assert not (folder / "answer").exists()


WRONG = {
    "does not load": (CODE.replace("import numpy", "import nunpy"), r"my_ball.py, line \d+: ModuleNot"),
    "is none": ("X = 1", "has neither a SUBJECT nor a function `measured`"),
    "tables": (CODE.replace('number("drag"', 'number("drg"'), r"line \d+: ValueError: drag sets drg; the"),
    "simulate": (CODE.replace("p.drag *", "p.drga *"), r"no attribute 'drga' \(my_ball.py, line \d+\)"),
    "channel": (CODE.replace('{"height": np', '{"heights": np'), "simulate gives no height; it gives"),
    "column": (CODE.replace('block="drop"', 'block="dorp"'), "no column dorp; there are drop, time, height"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_file_that_is_no_rig_is_told_with_its_line(call: Call, folder: Path, name: str) -> None:
    code, words = WRONG[name]
    rig, drops = written(folder, code)
    said = call("diagnose", "--subject", rig, drops, "--out", folder / "answer")
    assert said.code == FAILED
    assert re.search(words, said.err), said.err
    assert "Traceback" not in said.err


def test_a_name_that_something_else_has_and_files_that_are_no_tables_are_told(
    call: Call, folder: Path
) -> None:
    rig, drops = written(folder)
    rig.rename(folder / "json.py")
    out = ("--out", folder / "answer")
    assert "another module has its name" in call("diagnose", "--subject", folder / "json.py", drops, *out).err
    said = call("diagnose", "--subject", "bowling_ball", drops, *out)
    assert "is no Python file, and of installed subjects there is none" in said.err
    (folder / "my_ball.py").write_text(CODE)
    (folder / "words.csv").write_text("drop,time,height\n1,0,high\n")
    for data, words in (("words.csv", "invalid value 'high'"), ("gone.csv", "gone.csv")):
        said = call("diagnose", "--subject", folder / "my_ball.py", folder / data, *out)
        assert said.code == FAILED
        assert words in said.err


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.npz", b"PK\x03\x04" + bytes(100)),
        ("a.npz", b""),
        ("a.csv", b""),
        ("a.csv", b"time,time\n1,2\n"),
        ("a.csv", b"time,height\n1,2\n3\n"),
    ],
)
def test_files_that_are_no_tables_of_numbers_are_told(folder: Path, name: str, content: bytes) -> None:
    (folder / name).write_bytes(content)
    with pytest.raises(LogError, match=f"^{folder / name}: "):
        columns_of(folder / name)


def test_a_file_that_unpacks_to_far_more_than_it_is_is_refused(folder: Path) -> None:
    np.savez_compressed(folder / "a.npz", height=np.zeros(1 << 27, np.uint8))
    with bounded(), pytest.raises(LogError, match="more would come of it than of any honest recording"):
        columns_of(folder / "a.npz")


def test_a_table_may_begin_with_whole_numbers(folder: Path) -> None:
    (folder / "a.csv").write_text("time,height\n" + "1,2\n" * (1 << 18) + "0.5,\n")
    columns = columns_of(folder / "a.csv")
    assert columns["time"][[0, -1]].tolist() == [1.0, 0.5]
    assert np.isnan(columns["height"]).nonzero()[0].tolist() == [1 << 18]


def test_an_own_rig_is_not_fitted_to_the_way_to_rest(folder: Path) -> None:
    with LogWriter(folder / "a.mcap") as log:
        log.declare("measured", Channel("height", "m"))
        for second in range(3):
            values = np.full(100, second, np.float32)
            log.add_block(
                "measured", SampleBlock("height", 100 * second, second * NS_PER_S, 100.0, values), 1
            )
        log.add_event(Event(2 * NS_PER_S, "warning", "rig", STOPPING, "stopped"))
    columns = columns_of(folder / "a.mcap")
    assert (len(columns["time"]), columns["height"].max()) == (200, 1.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--subject", "a.py", "--model", "m.toml"), "--model goes with rattle's own rigs only"),
        (("--rigs", 20), "--rigs goes with --subject only"),
    ],
)
def test_options_of_the_other_kind_of_rig_are_refused(
    call: Call, tmp_path: Path, options: tuple[object, ...], words: str
) -> None:
    said = call("diagnose", tmp_path / "a.csv", "--out", tmp_path, *options)
    assert (said.code, words in said.err) == (WRONG_USE, True), said.err
