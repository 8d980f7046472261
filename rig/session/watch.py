"""What is looked at while a sequence waits: whatever ends its run."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from daq.clock import Clock
from daq.errors import RattleError
from drivers.protocols.emergency_stop import LOOK_S
from rig.session.acquisition import Acquisition

_T = TypeVar("_T")
_BLOCK_S = 0.1  # as often as the card's readings come
_SILENCE_S = 5.0  # without a sample; while it moves the guard is quicker
ASK_S = 0.1  # an exchange costs a generator's link some ms, which the guard may be waiting for


class Watch:
    """Calls every one of `checks`, in their order, while it waits; what one of them raises ends the run."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._looked_s = clock.monotonic_s()
        self.checks: list[Callable[[], None]] = []

    def hangs(self, after_s: float) -> bool:
        """Whether nobody has looked for so long that the run must be taken for dead."""
        return self._clock.monotonic_s() - self._looked_s > after_s

    def excuse(self, seconds: float) -> None:
        """Nobody needs to look for so long."""
        self._looked_s = self._clock.monotonic_s() + seconds

    def at_times(self, check: Callable[[], None]) -> None:
        """Call it as well, but every 0.1 s at most: it asks an instrument."""
        due_s = self._clock.monotonic_s()

        def checked() -> None:
            nonlocal due_s
            if (now_s := self._clock.monotonic_s()) >= due_s:
                due_s = now_s + ASK_S
                check()

        self.checks.append(checked)

    def check(self) -> None:
        """Raise whatever ends the run: a lost device, a limit, a person."""
        self._looked_s = self._clock.monotonic_s()
        for check in self.checks:
            check()
            self._looked_s = max(self._looked_s, self._clock.monotonic_s())  # each may take as long as it may

    def wait(self, seconds: float) -> None:
        end = self._clock.monotonic_s() + seconds
        while (left := end - self._clock.monotonic_s()) > 0:
            self.check()
            self._clock.sleep(min(left, LOOK_S))
        self.check()

    def until(
        self, acquisition: Acquisition, done: Callable[[], bool], show: Callable[[], None] = lambda: None
    ) -> None:
        """Wait until `done` while samples come; raises what ends the run early, and where none come."""
        silent_since, seen = self._clock.monotonic_s(), -1
        while not done():
            self.check()
            with acquisition.changed:
                acquisition.changed.wait(_BLOCK_S)
            show()
            if acquisition.acquired != seen:
                silent_since, seen = self._clock.monotonic_s(), acquisition.acquired
            elif self._clock.monotonic_s() - silent_since > _SILENCE_S:
                raise RattleError(f"{acquisition.name} gave no samples for {_SILENCE_S:g} s")
        self.check()

    def meanwhile(self, acquisition: Acquisition, compute: Callable[[], _T]) -> _T:
        """What `compute` gives or raises, in a thread: beside much else it may take many times as long."""
        found: Future[_T] = Future()

        def run() -> None:
            try:
                found.set_result(compute())
            except Exception as error:  # top of a thread: raised again by whoever waits
                found.set_exception(error)

        threading.Thread(target=run, name="computation", daemon=True).start()
        self.until(acquisition, found.done)
        return found.result()
