"""Hands frames to another process without ever making the caller wait."""

from __future__ import annotations

import fcntl
import os
import select
import threading
from collections import deque

from rig.live.frames import Dropped, encode

_PERIOD_S = 0.05
"""Frames leave in batches: one wake-up of the thread in 50 ms, not one a block, and no eye sees 50 ms."""

_PIPE_BYTES = 1 << 20
_WRITE_BYTES = 1 << 18
_F_SETPIPE_SZ = 1031  # linux/fcntl.h; the fcntl module has it only where the C library's header does


class FrameSender:
    """Frames in memory, at most `maximum_bytes` of them, and a thread that writes them to a pipe.

    A full memory drops its oldest frame and counts it in `dropped`. Once the reader is gone `broken` is set
    and nothing is kept.
    """

    def __init__(self, fd: int, maximum_bytes: int) -> None:
        self.dropped = 0
        self.broken = False
        self._fd = fd
        self._maximum_bytes = maximum_bytes
        self._frames: deque[bytes] = deque()
        self._bytes = 0
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._deadline_reached = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live view sender", daemon=True)

    def start(self) -> None:
        """Start the thread; it owns the pipe's end from now on."""
        os.set_blocking(self._fd, False)
        self._writable = select.poll()
        self._writable.register(self._fd, select.POLLOUT)
        fcntl.fcntl(self._fd, _F_SETPIPE_SZ, _PIPE_BYTES)
        self._thread.start()

    def offer(self, frame: bytes) -> None:
        """Queue a frame; returns at once, whatever the reader does."""
        if self.broken:
            self.dropped += 1
            return
        with self._lock:
            self._frames.append(frame)
            self._bytes += len(frame)
            while self._bytes > self._maximum_bytes:
                self._bytes -= len(self._frames.popleft())
                self.dropped += 1

    def close(self, timeout_s: float) -> None:
        """Send what is queued for at most `timeout_s`, then close the pipe: the reader sees its end."""
        self._stop.set()
        self._thread.join(timeout_s)
        self._deadline_reached.set()
        self._thread.join()

    def _run(self) -> None:
        told = 0
        try:
            while True:
                stopping = self._stop.wait(_PERIOD_S)
                if told != self.dropped:
                    told = self.dropped
                    self._write(encode(Dropped(told)))
                self._drain()
                if stopping:
                    return
        except OSError:
            self.broken = True  # the reader died; the log does not depend on it
        finally:
            os.close(self._fd)

    def _drain(self) -> None:
        while True:
            with self._lock:
                frame = self._frames.popleft() if self._frames else None
                self._bytes -= len(frame) if frame else 0
            if frame is None:
                return
            self._write(frame)

    def _write(self, frame: bytes) -> None:
        rest = memoryview(frame)
        while rest:
            if self._deadline_reached.is_set():
                raise BrokenPipeError
            if self._writable.poll(1000 * _PERIOD_S):
                rest = rest[self._write_some(rest) :]

    def _write_some(self, data: memoryview) -> int:
        try:
            return os.write(self._fd, data[:_WRITE_BYTES])
        except BlockingIOError:
            return 0
