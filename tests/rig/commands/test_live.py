"""`rattle live`: the machine's page by hand, on its port or on another one."""

from __future__ import annotations

import pytest

from rig.live.page_server import PORT_VARIABLE, PageServer, page_url
from tests.rig.commands.cli import Call


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> int:
    """A free one, of a page that soon ends because nobody asks."""
    monkeypatch.setattr("rig.live.page_server.IDLE_S", 0.2)
    with PageServer(0) as free:
        return free.port


def test_it_serves_until_nobody_asks_for_long(call: Call, port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PORT_VARIABLE, str(port))
    answer = call("live")
    assert (answer.code, answer.err) == (0, "")
    assert answer.out == f"live view  {page_url(port)}; Ctrl-C ends it\n"
    answer = call("live", "--stop")
    assert answer.out == f"{page_url(port)} was not up\n"


def test_on_another_port_it_says_how_runs_get_there(call: Call, port: int) -> None:
    told = f"runs       come here with {PORT_VARIABLE}={port} in their environment\n"
    assert call("live", "--port", port).out == f"live view  {page_url(port)}; Ctrl-C ends it\n{told}"
    with PageServer(0) as up:
        up_there = call("live", "--port", up.port).out
    told = told.replace(str(port), str(up.port))
    ends = f"rattle live --port {up.port} --stop ends it"
    assert up_there == f"live view  {page_url(up.port)} is up; {ends}\n{told}"
