"""The live view's page through a run at a terminal: up before it, armed, told until it is over."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from rig.live.page_server import PORT_VARIABLE, PageServer
from tests.end_to_end.command import ROOT, rattle
from tests.end_to_end.conftest import SpiedBench
from tests.end_to_end.files import write_scenario

DEADLINE_S = 60.0


class Watched:
    """What a browser at the page gets to see."""

    def __init__(self, server: PageServer) -> None:
        self._server, self._number = server, 0
        self.stages: list[str] = []

    def await_stage(self, beginning: str, more: str = "null") -> dict[str, Any]:
        """The first state of that stage in which a channel has `more`."""
        deadline = time.monotonic() + DEADLINE_S
        while time.monotonic() < deadline:
            found = self._server.after(self._number)
            if found is None:
                continue
            self._number, text = found
            state: dict[str, Any] = json.loads(text) or {"stage": {"text": ""}}
            stage = state["stage"]["text"]
            if not self.stages or self.stages[-1] != stage:
                self.stages.append(stage)
            if stage.startswith(beginning):
                channels = state["channels"]
                if more == "null" or (channels and channels[0][more] is not None):
                    return state
        raise AssertionError(f"{beginning!r} never came: {self.stages}")


def test_a_run_at_a_terminal_is_armed_waits_for_enter_and_is_told_to_its_end(
    bench: SpiedBench, tmp_path: Path
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml")
    ours, theirs = pty.openpty()
    arguments = ["run", scenario, "--bench", bench.file, "--out", tmp_path, "--live"]
    os.write(ours, b"\n")  # impatient; it is not meant for what comes later
    with PageServer(0) as server, contextlib.ExitStack() as stack:
        run = subprocess.Popen(  # noqa: S603
            [sys.executable, "-m", "rig.start", *map(str, arguments)],
            cwd=ROOT,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=os.environ | {PORT_VARIABLE: str(server.port), "TERM": "xterm", "COLUMNS": "100"},
        )
        os.close(theirs)
        said: list[bytes] = []

        def read() -> None:
            with contextlib.suppress(OSError):
                while text := os.read(ours, 4096):
                    said.append(text)

        reading = threading.Thread(target=read)
        reading.start()
        for each in (lambda: os.close(ours), reading.join, run.wait, run.kill):  # the last one first
            stack.callback(each)
        watched = Watched(server)
        armed = watched.await_stage("armed: Enter at the terminal starts", "level")
        assert len(armed["channels"]) == 5
        assert armed["channels"][0]["bounds"][0] is not None
        for _ in range(5):  # a second, in which nothing may begin
            watched.await_stage("armed: Enter at the terminal starts")
        assert not bench.spy.moved
        os.write(ours, b"\n")
        recorded = watched.await_stage("finished", "most")
        assert bench.spy.moved
        assert {"settling", "recording"} <= set(watched.stages)
        assert all(each is not None for each in recorded["channels"][0]["traces"]["predicted"])
        while not (found := watched.await_stage("finished"))["outcome"]:
            pass  # judged and reported only now
        assert found["outcome"]["sentences"][0].startswith("Not judged")
        report = tmp_path / found["outcome"]["report"]
        assert server.report == report.read_bytes()
        os.write(ours, b"\n")  # closes the time line
        assert run.wait(DEADLINE_S) == 0, b"".join(said).decode()
        while not watched.await_stage("finished")["ended"]:
            pass


@pytest.mark.long
def test_a_replay_is_shown_on_the_page_that_is_there(
    settled_log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with PageServer(0) as server:
        monkeypatch.setenv(PORT_VARIABLE, str(server.port))
        ended = rattle("replay", settled_log, "--speed", "0", "--live")
        assert ended.code == 0, ended.err
        assert f"live view  {server.url}" in ended.out
        state = Watched(server).await_stage("replayed", "most")
    assert state["ended"]
    assert all(each is not None for each in state["channels"][0]["traces"]["predicted"])
    assert [row[0] for row in state["figures"]] == ["", "impacts", "largest"]


def test_a_taken_port_is_told_before_anything_is_connected(
    bench: SpiedBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml")
    with socket.create_server(("127.0.0.1", 0)) as other:
        monkeypatch.setenv(PORT_VARIABLE, str(other.getsockname()[1]))
        ended = rattle("run", scenario, "--bench", bench.file, "--out", tmp_path, "--live")
    assert ended.code == 1
    assert "another program has this port" in ended.err
    assert not bench.spy.heard
    assert list(tmp_path.glob("*.mcap")) == []
