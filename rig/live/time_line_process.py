"""The process that talks to Rerun: shows the records that come until there are no more.

Rerun blocks its caller while the viewer's server stalls, and drops without a word once it is gone: so all of
it happens here, where nobody waits. What comes faster than Rerun takes it is dropped by who sends it.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from urllib.parse import quote

import rerun as rr

from daq.errors import InstrumentAbsent
from daq.process import give_way
from daq.signals.even_angles import warm_up
from rig.live.blueprint import blueprint
from rig.live.picture import Layout
from rig.live.scene import Scene
from rig.live.view import LAST_WORDS_S, Shown

_HOST = "127.0.0.1"
_START_TIMEOUT_S = 15.0
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
        while self._process.poll() is None and time.monotonic() < deadline:
            # the ports of one that is gone may be another program's
            if _listens(self.grpc_port) and _listens(self.web_port) and self._process.poll() is None:
                return self
            time.sleep(0.02)
        self.__exit__()
        raise InstrumentAbsent("viewer server", _HOST, "it did not start")

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


def serve(pipe: Connection, records: Connection, patience_s: float, memory_limit: str) -> None:
    """Show the records that come until None does.

    The first answer on `pipe` is Rerun's two addresses and the server's process.
    """
    warm_up()  # while nobody sends anything yet
    try:
        with ViewerServer(memory_limit) as server:
            url = f"http://{_HOST}:{server.web_port}/?url={quote(server.sink_url, safe='')}"
            pipe.send((url, server.sink_url, server.pid))
            give_way()
            _show(_frames(records), server.sink_url, patience_s)
    except InstrumentAbsent as error:
        pipe.send(str(error))


def _frames(records: Connection) -> Iterator[Shown]:
    """What comes, until None does or whoever sent it is gone."""
    with contextlib.suppress(EOFError, OSError):
        while (frame := records.recv()) is not None:
            yield frame


def _show(frames: Iterator[Shown], sink_url: str, patience_s: float) -> None:
    """In Rerun, each layout as a recording of its own."""
    recording = scene = None
    for frame in frames:
        if isinstance(frame, Layout):
            _finish(recording, scene)
            recording = rr.RecordingStream("rattle")
            recording.connect_grpc(sink_url, default_blueprint=blueprint(frame))
            recording.send_recording_name(frame.title)
            scene = Scene(recording, frame, patience_s)
            scene.open()
        elif scene is not None:
            scene.show((frame,))
    _finish(recording, scene)


def _finish(recording: rr.RecordingStream | None, scene: Scene | None) -> None:
    if scene is not None and recording is not None:
        scene.finish()
        recording.flush(timeout_sec=LAST_WORDS_S)
