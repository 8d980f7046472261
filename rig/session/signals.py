"""Ctrl-C and its kin as a request that the run looks at, never as an exception in the middle of a command."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from daq.errors import RattleError

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
_ECHO_S, _AGAIN_S = 0.05, 0.3
"""One wish may come as several signals, the same one or others, of the terminal and of what started the run:
they count as one. Nobody presses a key again as soon as the first."""


class Stopped(RattleError, RuntimeError):
    """A person stopped the run; the rig is in its safe state."""


class StopRequest:
    """While the context lasts, a signal only counts as `asked`; whoever waits looks at it, with `check`."""

    def __init__(self) -> None:
        self._before: dict[signal.Signals, object] = {}  # handlers to put back; an outer request among them
        self.asked, self._asked_s, self._asked_by = 0, -math.inf, 0
        self._at_once = False

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():
            for each in STOP_SIGNALS:
                self._before[each] = signal.signal(each, self._note)
        return self

    def __exit__(self, *error: object) -> None:
        for each, handler in self._before.items():
            signal.signal(each, handler)  # type: ignore[arg-type]

    @property
    def wanted(self) -> bool:
        return self.asked > 0

    def check(self) -> None:
        if self.wanted:
            raise Stopped("stopped by a person")

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """The first signal raises Stopped: for what waits where nobody looks, while nothing moves."""
        self._at_once = True
        try:
            yield
        finally:
            self._at_once = False

    def _note(self, number: int, frame: FrameType | None) -> None:
        if time.monotonic() - self._asked_s < (_ECHO_S if number == self._asked_by else _AGAIN_S):
            return
        self._asked_s, self._asked_by = time.monotonic(), number
        self.asked += 1
        outer = getattr(self._before.get(signal.Signals(number)), "__self__", None)
        if isinstance(outer, StopRequest):
            outer.asked += 1  # a series of runs is to end with the run
        if self._at_once:
            self._at_once = False  # whoever asks again leaves nothing half ended
            self.check()
