"""The process that talks to Rerun: shows the records that come until there are no more.

Rerun blocks its caller while the viewer's server stalls, and drops without a word once it is gone: so all of
it happens here, where nobody waits.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Full, Queue
from urllib.parse import quote

import rerun as rr

from daq.errors import InstrumentAbsent
from rig.live.blueprint import blueprint
from rig.live.page_server import PageServer, Teller
from rig.live.page_state import PERIOD_S, PageState
from rig.live.picture import Layout
from rig.live.scene import Scene
from rig.live.view import LAST_WORDS_S, Dropped, Progress, Shown

_HOST = "127.0.0.1"
_START_TIMEOUT_S = 15.0
_WAITING = 4096
"""Records on their way to Rerun: 3 s of 64 channels, measured and predicted."""
_PR_SET_PDEATHSIG = 1  # prctl(2)


class ViewerServer:
    """The `rerun` binary serving its web page and taking samples over gRPC, both on free loopback ports.

    It dies with the thread that opened it.
    """

    def __init__(self, memory_limit: str) -> None:
        with contextlib.ExitStack() as stack:
            free = [stack.enter_context(socket.create_server((_HOST, 0))) for _ in range(2)]
            self.grpc_port, self.web_port = (int(each.getsockname()[1]) for each in free)
        self._memory_limit = memory_limit

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def sink_url(self) -> str:
        return f"rerun+http://{_HOST}:{self.grpc_port}/proxy"

    def __enter__(self) -> ViewerServer:
        """Start the server and wait until it listens; raises InstrumentAbsent if it does not."""
        self._process = subprocess.Popen(  # noqa: S603
            [
                viewer_executable(),
                "--serve-web",
                f"--bind={_HOST}",
                f"--port={self.grpc_port}",
                f"--web-viewer-port={self.web_port}",
                # not --newest-first: the layout would be made active before it is there, and be lost at times
                f"--server-memory-limit={self._memory_limit}",
            ],
            stdin=subprocess.DEVNULL,
            env=viewer_environment(),
            preexec_fn=lambda: ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL),
        )
        deadline = time.monotonic() + _START_TIMEOUT_S
        while not (_listens(self.grpc_port) and _listens(self.web_port)):
            if self._process.poll() is not None or time.monotonic() > deadline:
                self.__exit__()
                raise InstrumentAbsent("viewer server", _HOST, "it did not start")
            time.sleep(0.02)
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait()


def viewer_executable() -> Path:
    """Return the viewer's binary itself: killing the `rerun` script would leave it orphaned."""
    spec = find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise InstrumentAbsent("viewer server", _HOST, "rerun-sdk is not installed")
    return Path(spec.origin).parent / "rerun"


def viewer_environment() -> dict[str, str]:
    """Environment in which the binary reports no usage to its makers and prints no colours."""
    return {**os.environ, "CI": "true", "NO_COLOR": "1"}


def _listens(port: int) -> bool:
    try:
        with socket.create_connection((_HOST, port), timeout=0.2):
            return True
    except OSError:
        return False


def serve(pipe: Connection, patience_s: float, memory_limit: str, page_port: int | None) -> None:
    """Serve one view until None comes.

    The first answer is Rerun's two addresses, the server's process, and the address of the operator's page.
    """
    try:
        with contextlib.ExitStack() as stack:
            page_url, tell = "", None
            if page_port is not None:
                own = stack.enter_context(PageServer(0)) if page_port == 0 else None
                tell = Teller(page_port if own is None else own.port)
                stack.callback(tell.close, LAST_WORDS_S)
                page_url = "" if own is None else own.url
            server = stack.enter_context(ViewerServer(memory_limit))
            rerun_url = f"http://{_HOST}:{server.web_port}/?url={quote(server.sink_url, safe='')}"
            pipe.send((rerun_url, server.sink_url, server.pid, page_url))
            state = None if tell is None else PageState(tell, rerun_url)
            waiting = Queue[Shown | None](_WAITING)
            frames = iter(waiting.get, None)
            showing = threading.Thread(target=_show, args=(frames, server.sink_url, patience_s), daemon=True)
            showing.start()
            _hand_on(_frames(pipe, state), waiting)
            showing.join(LAST_WORDS_S)
            if state is not None:
                state.end()
    except InstrumentAbsent as error:
        pipe.send(str(error))


def _hand_on(frames: Iterator[Shown], waiting: Queue[Shown | None]) -> None:
    """To Rerun's thread; where too much waits there, the older half is dropped, and counted with the rest."""
    before = lost = 0
    for frame in frames:
        if isinstance(frame, Dropped):
            before = frame.records
        if waiting.full():
            for _ in range(_WAITING // 2):
                waiting.get()
            lost += _WAITING // 2
            waiting.put(Dropped(before + lost))
        waiting.put(Dropped(before + lost) if isinstance(frame, Dropped) else frame)
    with contextlib.suppress(Full):
        waiting.put(None, timeout=LAST_WORDS_S)


def _frames(pipe: Connection, state: PageState | None) -> Iterator[Shown]:
    """What comes, until None does; the page's state hears of it first."""
    while True:
        try:
            while state is not None and not pipe.poll(PERIOD_S):
                state.look()
            frame = pipe.recv()
        except (EOFError, OSError):
            frame = None
            if state is not None:
                state.take(Progress("the run has gone without a word"))
        if frame is None:
            return
        if state is not None:
            state.take(frame)
            state.look()
        yield frame


def _show(frames: Iterator[Shown], sink_url: str, patience_s: float) -> None:
    """In Rerun, from the first layout on."""
    recording = scene = None  # in a thread of its own: Rerun blocks where its server is gone or hangs
    for frame in frames:
        if isinstance(frame, Layout):
            recording = rr.RecordingStream("rattle")
            recording.connect_grpc(sink_url, default_blueprint=blueprint(frame))
            recording.send_recording_name(frame.title)
            scene = Scene(recording, frame, patience_s)
            scene.open()
        elif scene is not None:
            scene.show((frame,))
    if scene is not None and recording is not None:
        scene.finish()
        recording.flush(timeout_sec=LAST_WORDS_S)
