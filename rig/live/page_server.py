"""The operator's page: one small server a machine on a port that stays; runs and replays tell it their state.

It holds the newest state and nothing else, so that a browser that is slow sees fewer states and no old ones.
A run is joined by one connection, in its page process; that nobody serves, or hangs, costs it nothing.
"""

from __future__ import annotations

import errno
import http.client
import json
import os
import socket
import sys
import threading
import time
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

from daq.errors import InstrumentAbsent, RattleError

HOST: Final = "127.0.0.1"
PORT: Final = 8710
PORT_VARIABLE: Final = "RATTLE_LIVE_PORT"
"""In the environment: another port; 0 for a free one, of a page that ends with its run."""
_ABOUT: Final = {"program": "rattle live"}
_HELD_S, _HEARD_S, _ANSWERS_S = 10.0, 5.0, 2.0
_STARTS_S, _LOOK_S = 10.0, 0.05
IDLE_S: Final = 3600.0
_LARGEST: Final = 32 << 20
_SAYS: Final = 4096
"""Bytes of what one says of itself; another program may send without end."""
_TOO_MUCH: Final = OverflowError, RecursionError
"""Of JSON from strangers: a number, brackets."""
_DIGITS: Final = 20
_HTML: Final = "text/html; charset=utf-8"
_FILES: Final = {
    "/": ("page.html", _HTML),
    "/monitor": ("monitor.html", _HTML),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
}
"""By what is asked for. Each page goes to the other where the state is of the other kind."""


class PageServer(ThreadingHTTPServer):
    """Serves page and newest state on a loopback port, 0 for any free one; raises InstrumentAbsent if taken.

    While a run tells its state, one that began earlier is not shown.
    """

    daemon_threads = True
    request_queue_size = 64

    def __init__(self, port: int) -> None:
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            raise InstrumentAbsent("live view", f"{HOST}:{port}", _taken(error)) from error
        self.port = int(self.server_address[1])
        self.url = page_url(self.port)
        self._changed = threading.Condition()
        self._state, self._number = b"null", time.time_ns()
        self._began = 0.0
        self.report = b""
        self._ends = False
        self._told_s = -_HEARD_S
        self.asked_s = time.monotonic()

    def __enter__(self) -> PageServer:
        self.serving = threading.Thread(
            target=self.serve_forever, args=(_LOOK_S,), name="live page", daemon=True
        )
        self.serving.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.shutdown()
        self.server_close()
        with self._changed:
            self._ends = True
            self._changed.notify_all()

    def tell(self, state: bytes, began: float) -> bool:
        """Take a state of the run that began then (Unix time, s); returns whether it is shown."""
        with self._changed:
            now_s = time.monotonic()
            if began < self._began and now_s - self._told_s < _HEARD_S:
                return False
            self._began, self._told_s = began, now_s
            self._state, self._number = state, self._number + 1
            self._changed.notify_all()
        return True

    def tell_report(self, report: bytes, began: float) -> None:
        """Take the report of the run that began then, a page; an earlier run's is not asked for any more."""
        with self._changed:
            if began >= self._began:
                self.report = report

    def after(self, number: int) -> tuple[int, bytes] | None:
        """The newest state if it is another than `number`, at once or when it comes; None if none does."""
        with self._changed:
            self._changed.wait_for(lambda: self._number != number or self._ends, _HELD_S)
            if self._number != number:
                return self._number, self._state
        return None

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that goes away in the middle of an answer is none."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = 60.0
    disable_nagle_algorithm = True
    server: PageServer

    def do_GET(self) -> None:
        if not self._from_here():
            return
        path, _, number = self.path.partition("?after=")
        match path:
            case _ if path in _FILES:
                name, kind = _FILES[path]
                self._answer(Path(__file__).with_name(name).read_bytes(), kind)
            case "/about":
                self._answer(json.dumps(_ABOUT | {"pid": os.getpid()}).encode())
            case "/state":
                found = self.server.after(_whole(number) or 0)
                if found is None:
                    self._answer(b"", status=HTTPStatus.NO_CONTENT)
                else:
                    self._answer(found[1], number=found[0])
            case "/report" if self.server.report:
                self._answer(self.server.report, _HTML)
            case _:
                self._answer(b"", status=HTTPStatus.NOT_FOUND)

    def do_PUT(self) -> None:
        size = _whole(self.headers.get("Content-Length", ""))
        if not self._from_here() or size is None or size > _LARGEST:
            self.close_connection = True
            return
        body, (path, _, began) = self.rfile.read(size), self.path.rpartition("/")
        with suppress(ValueError):
            if float(began) <= time.time() + _HEARD_S:  # else nobody would ever be newer
                match path:
                    case "/state":
                        self.server.tell(body, float(began))
                    case "/report":
                        self.server.tell_report(body, float(began))
        self._answer(b"", status=HTTPStatus.NO_CONTENT)

    def do_DELETE(self) -> None:
        """End the server."""
        if self._from_here():
            self._answer(b"", status=HTTPStatus.NO_CONTENT)
            threading.Thread(target=self.server.shutdown, daemon=True).start()

    def _from_here(self) -> bool:
        """Whether this page or a program of this machine asks for it, not a page of the internet."""
        own = {f"{name}:{self.server.port}" for name in (HOST, "localhost")}
        origin = self.headers.get("Origin")
        if self.headers.get("Host") in own and (origin is None or origin.partition("://")[2] in own):
            self.server.asked_s = time.monotonic()
            return True
        self.close_connection = True
        self._answer(b"", status=HTTPStatus.FORBIDDEN)
        return False

    def _answer(
        self, body: bytes, kind: str = "application/json", status: int = HTTPStatus.OK, number: int = 0
    ) -> None:
        self.send_response(status)
        for name, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(body))),
            ("Cache-Control", "no-store"),
            ("X-Number", str(number)),
        ):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *told: object) -> None:
        """The terminal is the run's."""


def _whole(text: str) -> int | None:
    """A number; None where it is none, or longer than any of ours."""
    return int(text) if text.isdecimal() and len(text) <= _DIGITS else None


class Teller:
    """Tells the page at `port` the newest state, and a report, in its own thread; who calls never waits."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._began = time.time()
        self._untold: dict[str, bytes] = {}
        self._changed = threading.Condition()
        self._ends = False
        self._thread = threading.Thread(target=self._run, name="live page teller", daemon=True)
        self._thread.start()

    def __call__(self, state: bytes) -> None:
        self._tell("state", state)

    def report(self, page: bytes) -> None:
        """The run's report, before the state that links to it."""
        self._tell("report", page)

    def _tell(self, what: str, body: bytes) -> None:
        with self._changed:
            self._untold[what] = body
            self._changed.notify()

    def close(self, timeout_s: float) -> None:
        """Tell what is left, at most that long."""
        with self._changed:
            self._ends = True
            self._changed.notify()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        link = http.client.HTTPConnection(HOST, self._port, timeout=_ANSWERS_S)
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._untold or self._ends)
                untold, self._untold = self._untold, {}
            if not untold:
                break
            for what in sorted(untold):
                try:
                    link.request("PUT", f"/{what}/{self._began!r}", untold[what])
                    link.getresponse().read(_SAYS)
                except (OSError, http.client.HTTPException):
                    link.close()  # the next state tries again: somebody may have started it anew
        link.close()


def page_port() -> int:
    """The port of this machine's page; raises RattleError where the environment has none."""
    text = os.environ.get(PORT_VARIABLE, "") or str(PORT)
    port = _whole(text)
    if port is None or port > 65_535:
        raise RattleError(f"{PORT_VARIABLE} is {text}: a port, 1 to 65535, or 0 for one of each run's own")
    return port


def page_url(port: int) -> str:
    """Where the page is."""
    return f"http://{HOST}:{port}/"


def serve_page(port: int) -> None:
    """Serve until DELETE, an interrupt, or an hour in which neither a run nor a browser has asked."""
    with PageServer(port) as server:
        while server.serving.is_alive() and time.monotonic() - server.asked_s < IDLE_S:
            time.sleep(_LOOK_S)


def answering(port: int) -> int | None:
    """The process that serves the page there; None where nobody listens, InstrumentAbsent if another does."""
    try:
        _, _, body = _told_by(port).partition(b"\r\n\r\n")
        said: Any = json.loads(body)
        if said["program"] == _ABOUT["program"]:
            return int(said["pid"])
    except ConnectionRefusedError:
        return None
    except (OSError, ValueError, LookupError, TypeError, *_TOO_MUCH):
        pass  # whoever it is
    raise InstrumentAbsent("live view", f"{HOST}:{port}", _taken())


def _told_by(port: int) -> bytes:
    """What whoever listens there says of itself, as far as that comes in time."""
    said, until_s = b"", time.monotonic() + _ANSWERS_S
    with socket.create_connection((HOST, port), timeout=_ANSWERS_S) as link:
        link.sendall(f"GET /about HTTP/1.0\r\nHost: {HOST}:{port}\r\n\r\n".encode())
        while len(said) < _SAYS and (left_s := until_s - time.monotonic()) > 0:
            link.settimeout(left_s)
            if not (more := link.recv(_SAYS)):
                break
            said += more
    return said


def _taken(error: Exception | None = None) -> str:
    if isinstance(error, OSError) and error.errno != errno.EADDRINUSE:
        return f"{error.strerror or error}: name another port in {PORT_VARIABLE}"
    return f"another program has this port: end it, or name another one in {PORT_VARIABLE}"


def ensure_page(port: int) -> None:
    """Start this machine's page unless it is there; it stays. Raises InstrumentAbsent where it cannot."""
    if answering(port) is not None:
        return
    PageServer(port).server_close()  # a port that it cannot have says so here, not in a process of its own
    null = os.open(os.devnull, os.O_RDWR)
    try:
        os.posix_spawn(
            sys.executable,
            [sys.executable, "-P", "-m", "rig.start", "live", "--port", str(port)],  # nothing of this folder
            os.environ,
            file_actions=[(os.POSIX_SPAWN_DUP2, null, each) for each in (0, 1, 2)],
            setsid=True,  # what its terminal sends is not for it: it outlives the run
        )
    finally:
        os.close(null)
    deadline = time.monotonic() + _STARTS_S
    while answering(port) is None:
        if time.monotonic() > deadline:
            raise InstrumentAbsent("live view", f"{HOST}:{port}", f"it did not start within {_STARTS_S:g} s")
        time.sleep(_LOOK_S)


def stop_page(port: int) -> bool:
    """End this machine's page; returns whether there was one."""
    if answering(port) is None:
        return False
    link = http.client.HTTPConnection(HOST, port, timeout=_ANSWERS_S)
    with suppress(OSError, http.client.HTTPException):
        link.request("DELETE", "/")
        link.getresponse().read(_SAYS)
    link.close()
    deadline = time.monotonic() + _ANSWERS_S
    while time.monotonic() < deadline:
        with suppress(ConnectionRefusedError), socket.create_connection((HOST, port), timeout=_ANSWERS_S):
            time.sleep(_LOOK_S)
            continue
        break
    return True
