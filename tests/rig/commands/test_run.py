"""`rattle run` to its end on a rig that is made up, so that it takes no time."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from rig.session.progress import Screen
from tests.end_to_end.files import write_scenario
from tests.rig.commands.cli import Call
from tests.rig.session.test_stops import InTurn, in_turn
from tests.rig.synthetic_run import write_log

__all__ = ["in_turn"]


@contextmanager
def impatient(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A person who presses Enter again and again."""
    reading, writing = os.pipe()
    ended = threading.Event()

    def press() -> None:
        while not ended.wait(0.2):
            os.write(writing, b"\n")

    with open(reading) as there, open(writing, "wb"):
        monkeypatch.setattr("sys.stdin", there)
        pressing = threading.Thread(target=press)
        pressing.start()
        try:
            yield
        finally:
            ended.set()
            pressing.join()


def test_a_run_until_enter_tells_another_program_what_it_came_to(
    call: Call, in_turn: InTurn, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.app.connect", in_turn.connect)
    folder, scenario = in_turn.rig.folder, in_turn.rig.folder / "s.toml"
    scenario.write_text(in_turn.rig.scenario.text)
    asked = ("--set", "acquisition.settle=0 s", "--until-stopped", "--json", "--out", folder / "runs")
    with impatient(monkeypatch):
        answer = call("run", scenario, *asked)
    assert answer.code == 0, answer.err
    assert "Enter ends the record, at the latest after " in answer.err
    assert "recording ..." in answer.err
    told = json.loads(answer.out)
    assert Path(told["log"]).parent == folder / "runs"
    assert Path(told["report"]).is_file()
    assert 0.05 < told["duration_s"] < 20.0
    assert set(told["channels"]) == {channel.name for channel in in_turn.rig.card.channels}


class Unseen:
    """A live view that nobody sees."""

    def offer(self, what: object) -> None: ...


def test_the_report_is_written_before_a_live_view_is_held_open(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However that ends, by a signal or with the terminal, it is there."""
    log, there = write_log(tmp_path / "run.mcap", 0.2), list[bool]()

    def hold(screen: Screen, text: str, ended: Callable[[], bool]) -> None:
        there.append(log.with_suffix(".html").is_file())

    monkeypatch.setattr("rig.session.run.run_scenario", lambda *_: log)
    monkeypatch.setattr("rig.session.on_page.on_page", lambda _: nullcontext(Unseen()))
    monkeypatch.setattr(Screen, "hold", hold)
    answer = call("run", write_scenario(tmp_path / "s.toml"), "--live", "--out", tmp_path / "runs")
    assert answer.code == 0, answer.err
    assert there == [True]
