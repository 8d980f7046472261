"""Time, passed in so that tests can step it."""

from __future__ import annotations

import time
from types import ModuleType, SimpleNamespace
from typing import Protocol

_LOOKS = 5
"""At both clocks: a thread that lost the processor between two readings shows in how long its look took."""


class Clock(Protocol):
    """Wall time for stamps, monotonic time for deadlines, and waiting."""

    def unix_ns(self) -> int:
        """Nanoseconds since the Unix epoch; may step."""

    def monotonic_s(self) -> float:
        """Seconds that never step back; the same zero for all processes of the machine."""

    def sleep(self, seconds: float) -> None: ...


class SystemClock:
    """The machine's own clocks."""

    def unix_ns(self) -> int:
        return time.time_ns()

    def monotonic_s(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


def wait_steadily(*modules: ModuleType) -> None:
    """Have modules of libraries time their waits by the monotonic clock: the wall clock may be set back.

    For those that ask `time.time`, or `time` by that name, for nothing else.
    """
    for module in modules:
        whole = isinstance(module.time, ModuleType)
        steady = SimpleNamespace(**vars(time) | {"time": time.monotonic}) if whole else time.monotonic
        vars(module)["time"] = steady


def wall_less_monotonic_ns(clock: Clock) -> int:
    """What the wall clock is ahead of the monotonic one now, by the quickest of some looks at both.

    Turns a stamp of a device that knows the wall clock into the time in which everything else is measured; to
    be asked for anew each time, for a time service slews and an operator steps the wall clock.
    """

    def look() -> tuple[float, int]:
        before_s, wall_ns, after_s = clock.monotonic_s(), clock.unix_ns(), clock.monotonic_s()
        return after_s - before_s, wall_ns - round((before_s + after_s) / 2 * 1e9)

    return min(look() for _ in range(_LOOKS))[1]
