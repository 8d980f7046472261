"""How a run waits: looking all the while at everything that may end it."""

from __future__ import annotations

from collections.abc import Callable

from daq.clock import Clock
from daq.errors import RattleError
from rig.session.acquisition import Acquisition

_LOOK_S = 0.02
_BLOCK_S = 0.1
_SILENCE_S = 5.0
HANGS_S = 3.0
"""A sequence that has looked at nothing for so long hangs, whatever the acquisition says."""


class Watch:
    """Calls every one of `checks`, in their order, while it waits; what one of them raises ends the run."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._looked_s = clock.monotonic_s()
        self.checks: list[Callable[[], None]] = []

    @property
    def hangs(self) -> bool:
        """Whether nobody has looked for so long that the run must be taken for dead."""
        return self._clock.monotonic_s() - self._looked_s > HANGS_S

    def check(self) -> None:
        """Raise whatever ends the run: a lost device, a limit, a person."""
        self._looked_s = self._clock.monotonic_s()
        for check in self.checks:
            check()

    def wait(self, seconds: float) -> None:
        """Wait; raises what ends the run meanwhile."""
        end = self._clock.monotonic_s() + seconds
        while (left := end - self._clock.monotonic_s()) > 0:
            self.check()
            self._clock.sleep(min(left, _LOOK_S))
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
