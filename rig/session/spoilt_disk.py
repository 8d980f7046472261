"""A disk that fails as it is rehearsed, under the log of a run."""

from __future__ import annotations

import errno
import io
import math
import os
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, Any

from drivers.rehearsal import Rehearsal, Rehearsed


class SpoiltFile(io.FileIO):
    """A new file on a disk to which `faults` come, by time since it was opened; for several threads."""

    def __init__(self, path: Path, faults: Iterable[Rehearsed]) -> None:
        self._rehearsal, self._opened_s = Rehearsal(faults), time.monotonic()
        self._room, self._rate, self._stalls_until_s = math.inf, math.inf, 0.0
        self._coming = threading.Lock()  # over faults that come, each of which comes once
        self._fails = set[str]()  # kinds of calls
        super().__init__(path, "xb")

    def write(self, data: Any, /) -> int:
        """As a file; OSError where the disk takes no more."""
        self._meet("write")
        size = memoryview(data).nbytes
        self._room -= size
        if self._room < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        time.sleep(size / self._rate)
        return super().write(data)

    def fileno(self) -> int:
        """As a file; OSError where its syncs, which ask for it, fail."""
        self._meet("sync")
        return super().fileno()

    def close(self) -> None:
        """As a file, and it is closed even so."""
        was_open = not self.closed
        super().close()
        if was_open:
            self._meet("close")

    def _meet(self, call: str) -> None:
        """What has come to the disk by now; raises OSError where this call fails by it."""
        now_s = time.monotonic()
        with self._coming:
            for fault in self._rehearsal.due(now_s - self._opened_s):
                match fault.kind:
                    case "stalls":
                        self._stalls_until_s = now_s + fault.number("for")
                    case "slow":
                        self._rate = fault.number("rate")
                    case "full":
                        self._room = fault.number("bytes")
                    case "sync_fails" | "close_fails":
                        self._fails.add(fault.kind.removesuffix("_fails"))
                    case _:
                        self._fails.add("write")
        time.sleep(max(self._stalls_until_s - now_s, 0.0))
        if call in self._fails:
            raise OSError(errno.EIO, os.strerror(errno.EIO))


def disk_of(faults: tuple[Rehearsed, ...]) -> Callable[[Path], IO[bytes]]:
    """How a new log is opened on such a disk; any other where nothing comes to it."""
    if not faults:
        return lambda path: path.open("xb")
    if any(fault.kind == "open_fails" for fault in faults):
        return _refuse
    return lambda path: io.BufferedWriter(SpoiltFile(path, faults))


def _refuse(path: Path) -> IO[bytes]:
    raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
