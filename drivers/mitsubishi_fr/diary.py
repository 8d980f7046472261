"""What happened to an instrument, kept until somebody asks for it."""

from __future__ import annotations

from collections import deque

from daq.clock import Clock
from drivers.protocols.notice import Notice

LONGEST = 1000


class Diary:
    """Notices with their time; the oldest go when nobody asks. One thread writes, another may take."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._notices: deque[Notice] = deque(maxlen=LONGEST)

    def note(self, level: str, code: str, text: str) -> None:
        """Keep what happens now."""
        self._notices.append(Notice(self._clock.monotonic_s(), level, code, text))

    def take(self) -> tuple[Notice, ...]:
        """Return the notices since the last call."""
        return tuple(self._notices.popleft() for _ in range(len(self._notices)))
