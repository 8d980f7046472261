"""The server of the operator's page: a port that stays, many runs, browsers that go, requests of others."""

from __future__ import annotations

import http.client
import os
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import psutil
import pytest

from daq.errors import InstrumentAbsent, RattleError
from rig.live.page_server import (
    HOST,
    PORT_VARIABLE,
    PageServer,
    Teller,
    answering,
    ensure_page,
    page_port,
    stop_page,
)


@pytest.fixture
def server() -> Iterator[PageServer]:
    with PageServer(0) as serving:
        yield serving


def ask(server: PageServer, method: str, path: str, body: bytes = b"", **headers: str) -> tuple[int, bytes]:
    link = http.client.HTTPConnection(HOST, server.port, timeout=5.0)
    try:
        link.request(method, path, body, headers)
        answer = link.getresponse()
        return answer.status, answer.read()
    finally:
        link.close()


def await_state(server: PageServer, wanted: bytes, seconds: float = 5.0) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if ask(server, "GET", "/state") == (200, wanted):
            return True
        time.sleep(0.01)
    return False


def test_a_browser_gets_the_newest_state_and_waits_for_the_next(server: PageServer) -> None:
    server.tell(b"1", 1.0)
    server.tell(b"2", 1.0)
    found = server.after(0)
    assert found is not None
    number, state = found
    assert state == b"2"
    late = threading.Timer(0.1, server.tell, (b"3", 1.0))
    late.start()
    found = server.after(number)
    late.join()
    assert found is not None
    assert found[1] == b"3"


def test_a_run_that_began_later_is_shown_and_an_earlier_one_once_that_is_silent(
    server: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert server.tell(b"first", 1.0)
    assert server.tell(b"second", 2.0)
    assert not server.tell(b"first again", 1.0)
    assert server.after(0) is not None
    monkeypatch.setattr("rig.live.page_server._HEARD_S", 0.0)
    assert server.tell(b"first again", 1.0)


@pytest.mark.parametrize("when", ["before it has asked", "while it waits", "in the middle of an answer"])
def test_a_browser_that_goes_away_is_not_noticed(
    server: PageServer, when: str, capfd: pytest.CaptureFixture[str]
) -> None:
    asks = f"GET /state?after={{}} HTTP/1.1\r\nHost: {HOST}:{server.port}\r\n"
    server.tell(b"0" * 30_000_000, 1.0)  # more than any socket holds
    number, _ = server.after(0) or (0, b"")
    for _ in range(3):
        with socket.create_connection((HOST, server.port)) as browser:
            asked = 0 if when == "in the middle of an answer" else number
            browser.sendall(asks.format(asked).encode() + b"\r\n" * (when != "before it has asked"))
            if asked == 0:
                assert browser.recv(100).startswith(b"HTTP/1.1 200")
            browser.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset
    teller = Teller(server.port)
    teller(b"on")  # and who waits is answered now
    assert await_state(server, b"on")
    teller.close(1.0)
    assert capfd.readouterr().err == ""


def test_who_tells_a_page_that_is_not_there_never_waits_and_goes_on_when_it_is() -> None:
    with PageServer(0) as first:
        port = first.port
    teller = Teller(port)
    before = time.monotonic()
    for number in range(100):
        teller(str(number).encode())
    assert time.monotonic() - before < 0.5
    with PageServer(port) as again:
        teller(b"newest")
        assert await_state(again, b"newest")
        teller.close(1.0)


@pytest.mark.parametrize(
    "headers", [{"Host": "evil.example"}, {"Origin": "http://evil.example"}, {"Origin": "null"}]
)
def test_a_page_of_the_internet_can_neither_read_nor_tell_nor_end(
    server: PageServer, headers: dict[str, str]
) -> None:
    server.tell(b"ours", 1.0)
    assert ask(server, "GET", "/state", **headers) == (403, b"")
    assert ask(server, "PUT", "/state/9e9", b"theirs", **headers)[0] == 403
    assert ask(server, "DELETE", "/", **headers)[0] == 403
    assert ask(server, "GET", "/state") == (200, b"ours")


@pytest.mark.parametrize("path", ["/state/nonsense", "/state/", "/state/inf", "/nothing"])
def test_what_no_run_tells_changes_nothing(server: PageServer, path: str) -> None:
    server.tell(b"ours", time.time())
    ask(server, "PUT", path, b"theirs")
    assert ask(server, "GET", "/state") == (200, b"ours")


def test_a_number_that_nobody_counts_to_is_none(server: PageServer) -> None:
    server.tell(b"ours", 1.0)
    assert ask(server, "GET", f"/state?after={'1' * 5000}") == (200, b"ours")


def test_a_run_hands_its_report_to_the_page(server: PageServer) -> None:
    assert ask(server, "GET", "/report")[0] == 404
    teller = Teller(server.port)
    teller.report(b"<p>sound</p>")
    teller(b"over")
    assert await_state(server, b"over")
    assert ask(server, "GET", "/report") == (200, b"<p>sound</p>")
    server.tell_report(b"of an earlier run", 1.0)
    assert ask(server, "GET", "/report") == (200, b"<p>sound</p>")
    teller.close(1.0)


@pytest.mark.parametrize(
    "said",
    [
        b"220 not a page\r\n",
        b"HTTP/1.0 200 OK\r\n\r\n" + b"[" * 2000,
        b'HTTP/1.0 200 OK\r\n\r\n{"program": "rattle live", "pid": 1e999}',
        b'HTTP/1.0 200 OK\r\n\r\n["rattle live"]',
    ],
)
def test_a_port_that_another_program_has_is_refused_with_what_to_do(said: bytes) -> None:
    with socket.create_server((HOST, 0)) as other:
        port = other.getsockname()[1]

        def answer() -> None:
            with other.accept()[0] as link:
                link.recv(1000)
                link.sendall(said)

        threading.Thread(target=answer, daemon=True).start()
        with pytest.raises(
            InstrumentAbsent, match=rf"{port}.*another program has this port.*{PORT_VARIABLE}"
        ):
            answering(port)
        with pytest.raises(InstrumentAbsent, match="another program has this port"), PageServer(port):
            pass


def test_another_program_that_drips_holds_nobody_up() -> None:
    with socket.create_server((HOST, 0)) as other:
        port = other.getsockname()[1]

        def drip() -> None:
            with other.accept()[0] as link, suppress(OSError):
                while True:
                    link.sendall(b" ")
                    time.sleep(0.1)

        threading.Thread(target=drip, daemon=True).start()
        began_s = time.monotonic()
        with pytest.raises(InstrumentAbsent, match="another program has this port"):
            answering(port)
        assert time.monotonic() - began_s < 5.0


def test_a_port_that_nobody_may_have_is_told_before_a_page_is_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(_: PageServer) -> None:
        raise PermissionError(13, "Permission denied")

    with PageServer(0) as free:
        port = free.port
    monkeypatch.setattr(PageServer, "server_bind", refused)
    with pytest.raises(InstrumentAbsent, match=rf"{port}.*Permission denied: name another port"):
        ensure_page(port)


@pytest.mark.parametrize("text", ["x", "-1", "70000", "8710 "])
def test_a_port_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv(PORT_VARIABLE, text)
    with pytest.raises(RattleError, match=f"{PORT_VARIABLE} is {text}"):
        page_port()


def test_the_machines_page_is_started_once_stays_on_loopback_and_ends_when_asked() -> None:
    with PageServer(0) as free:
        port = free.port
    assert answering(port) is None
    ensure_page(port)
    try:
        served_by = answering(port)
        assert served_by is not None
        ensure_page(port)
        assert answering(port) == served_by
        page = psutil.Process(served_by)
        assert {each.laddr.ip for each in page.net_connections() if each.status == "LISTEN"} == {HOST}
        assert os.getsid(served_by) == served_by  # what the terminal of its run sends is not for it
    finally:
        assert stop_page(port)
    assert answering(port) is None
    assert not stop_page(port)
    psutil.wait_procs([page], timeout=5.0)
