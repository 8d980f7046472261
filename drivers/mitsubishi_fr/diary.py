"""What happened to an instrument, kept until somebody asks for it."""

from __future__ import annotations

from collections import deque

from daq import Clock
from daq.log.records import Event

LONGEST = 1000


class Diary:
    """Events with their time; the oldest go when nobody asks. One thread writes, another may take."""

    def __init__(self, clock: Clock, source: str) -> None:
        self._clock, self._source = clock, source
        self._events: deque[Event] = deque(maxlen=LONGEST)

    def note(self, level: str, code: str, text: str) -> None:
        """Keep an event that happens now."""
        self._events.append(Event(self._clock.unix_ns(), level, self._source, code, text))

    def take(self) -> tuple[Event, ...]:
        """Return the events since the last call."""
        return tuple(self._events.popleft() for _ in range(len(self._events)))
