"""The host's time during a run: steady, whatever happens to the wall clock."""

from __future__ import annotations

import datetime

from daq.block import NS_PER_S
from daq.clock import Clock
from daq.log.records import Event

STEP_S = 0.05
"""A wall clock that moves against the monotonic one by more than this between two looks has stepped; both are
slewed alike by a time service, so that they do not part otherwise."""


class RunClock:
    """A `Clock` whose wall time was read once and goes on by the monotonic clock from there.

    Stamps, durations and the order in a file stay right when the machine's wall clock is set or stops;
    `look` says that it was.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._start_ns = clock.unix_ns()
        self._start_s = clock.monotonic_s()
        self._away_ns = 0  # what the wall clock is off by steps that were told already
        self._seen_ns = self._start_ns
        self._seen_s = self._start_s
        self._stopped = False

    def unix_ns(self) -> int:
        """Nanoseconds since the Unix epoch as of the start of the run; never steps."""
        return self.at_ns(self._clock.monotonic_s())

    def at_ns(self, monotonic_s: float) -> int:
        """What `unix_ns` said, or will say, at a time of the monotonic clock."""
        return self._start_ns + round((monotonic_s - self._start_s) * NS_PER_S)

    def monotonic_s(self) -> float:
        return self._clock.monotonic_s()

    def sleep(self, seconds: float) -> None:
        self._clock.sleep(seconds)

    def look(self) -> Event | None:
        """Look at the wall clock, about once a second: what happened to it since the last look, if anything.

        An event's time is the run's; its text gives both times. A clock that stands still is reported once.
        """
        wall_ns, steady_ns, now_s = self._clock.unix_ns(), self.unix_ns(), self._clock.monotonic_s()
        stands = wall_ns == self._seen_ns and now_s - self._seen_s > STEP_S
        began = stands and not self._stopped
        self._seen_ns, self._seen_s, self._stopped = wall_ns, now_s, stands
        if began:
            return _event(steady_ns, "clock.wall_stopped", "wall clock stands still", wall_ns)
        moved_ns = wall_ns - steady_ns - self._away_ns
        if stands or abs(moved_ns) <= STEP_S * NS_PER_S:
            return None
        self._away_ns += moved_ns
        return _event(
            steady_ns, "clock.wall_step", f"wall clock stepped by {moved_ns / NS_PER_S:+.3f} s", wall_ns
        )


def _event(time_ns: int, code: str, what: str, wall_ns: int) -> Event:
    text = f"{what}: it reads {_utc(wall_ns)}, the run's time is {_utc(time_ns)}; samples are not affected"
    return Event(time_ns, "warning", "host", code, text)


def _utc(unix_ns: int) -> str:
    seconds, rest = divmod(unix_ns, NS_PER_S)
    moment = datetime.datetime.fromtimestamp(seconds, datetime.UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{rest // 1_000_000:03d}Z"
