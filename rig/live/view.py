"""The acquisition's side of the live view: hands over copies and never waits."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from types import TracebackType

import psutil

from daq.channel import Channel
from daq.errors import InstrumentAbsent
from rig.live.frames import encode
from rig.live.layout import layout_of
from rig.live.picture import Picture
from rig.live.sender import FrameSender
from rig.stream import Record

_START_TIMEOUT_S = 30.0
_QUEUE_BYTES_A_TRACE = 512 << 10
"""2.5 s at 51.2 kHz: a twin that has just aligned sends its first seconds at once."""
_LEAST_TRACES = 32


class LiveView:
    """Shows a run in a browser at `url` while it runs; opened and closed in one thread, offered to from any.

    Two processes work behind it, one that talks to Rerun and Rerun's own server, both on loopback only. When
    they stall or die, what is offered is dropped and counted in `dropped`; the caller does not notice.
    Measured data waits up to `patience_s` for its prediction, so that both appear together.
    """

    def __init__(
        self,
        title: str,
        measured: Sequence[Channel],
        predicted: Sequence[Channel],
        picture: Picture | None = None,
        window_s: float = 3.0,
        patience_s: float = 3.0,
        memory_limit: str = "64MB",
        nominal: Sequence[Channel] = (),
        derived: Sequence[Channel] = (),
    ) -> None:
        self.url = ""
        self.sink_url = ""
        self._layout = layout_of(title, measured, predicted, picture, window_s, nominal, derived)
        self._patience_s = patience_s
        self._memory_limit = memory_limit
        self._server: psutil.Process | None = None
        self._open = False

    def open(self) -> LiveView:
        """Start both processes, wait until the page is there; raises InstrumentAbsent if it does not come."""
        reading, writing = os.pipe()
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115  closed in close()
        arguments = [self._layout.to_json(), str(self._patience_s), self._memory_limit]
        self._process = subprocess.Popen(  # noqa: S603
            [sys.executable, "-m", "rig.live.view_process", *arguments],
            stdin=reading,
            stdout=subprocess.PIPE,
            stderr=self._complaints,
            start_new_session=True,  # Ctrl-C is for the sequencer, which closes this view last
        )
        os.close(reading)
        traces = sum(len(names) for names in self._layout.origins.values())
        self._sender = FrameSender(writing, max(traces, _LEAST_TRACES) * _QUEUE_BYTES_A_TRACE)
        self._sender.start()
        self._open = True
        try:
            self._read_announcement()
        except InstrumentAbsent:
            self.close()
            raise
        return self

    @property
    def dropped(self) -> int:
        """Blocks, impacts, shapes and events that were offered and will not be shown."""
        return self._sender.dropped

    @property
    def alive(self) -> bool:
        """Whether both processes still run (they may be stalled)."""
        return self._open and self._process.poll() is None and _runs(self._server)

    @property
    def processes(self) -> tuple[int, int]:
        """Process ids of the view process and of the viewer's server."""
        return self._process.pid, self._server.pid if self._server else 0

    def offer(self, record: Record) -> None:
        """Show a record if there is time and a place for it; copies its values and returns at once."""
        if self._open and (frame := encode(record)):
            self._sender.offer(frame)

    def close(self, timeout_s: float = 4.0) -> None:
        """Let the view show what it has, at most `timeout_s`, and end both processes."""
        if not self._open:
            return
        self._open = False
        deadline = time.monotonic() + timeout_s
        self._sender.close(timeout_s / 3)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(max(deadline - time.monotonic(), 0.0))
        self._process.kill()
        self._process.wait()
        self._end_server()
        assert self._process.stdout is not None  # noqa: S101  it was asked for
        self._process.stdout.close()
        self._complaints.close()

    def __enter__(self) -> LiveView:
        return self.open()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read_announcement(self) -> None:
        answers = self._process.stdout
        assert answers is not None  # noqa: S101  it was asked for
        ready, _, _ = select.select([answers], [], [], _START_TIMEOUT_S)
        message = json.loads((ready and answers.readline()) or b"{}")
        if "url" not in message:
            what = message.get("error") or f"it did not start: {self._last_complaint()}"
            raise InstrumentAbsent("live view", "127.0.0.1", what)
        self.url, self.sink_url = message["url"], message["sink"]
        self._server = psutil.Process(message["server"])

    def _last_complaint(self) -> str:
        self._complaints.seek(0)
        lines = self._complaints.read().decode(errors="replace").split("\n")
        return next((line for line in reversed(lines) if line.strip()), "no word from it")

    def _end_server(self) -> None:
        """Make sure of it: the server dies with the view process, unless that was killed too early."""
        if self._server is not None:
            with contextlib.suppress(psutil.NoSuchProcess):
                self._server.kill()


def _runs(process: psutil.Process | None) -> bool:
    return process is not None and process.is_running() and process.status() != psutil.STATUS_ZOMBIE
