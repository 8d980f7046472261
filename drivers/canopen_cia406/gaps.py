"""Which positions are missing between those that are kept, and why."""

from __future__ import annotations

import math
from collections import deque

from drivers.canopen_cia406.order import Placed
from drivers.protocols.encoder import PositionGap

_MISSING, _UNREAD = "frames missing", "not read in time"
_NOT_CERTAIN = "; how many and where is not certain"
_MOST_CAUSES = 1000


class Gaps:
    """Is told of positions that are kept and of what became of others, and hands out the gaps."""

    def __init__(self) -> None:
        self.last: Placed | None = None
        self._gaps: deque[PositionGap] = deque()
        self._causes: deque[tuple[float, str]] = deque(maxlen=_MOST_CAUSES)
        self._unread = False

    def lost(self, timestamp_s: float, cause: str) -> None:
        """What came at this time was no position, or none came."""
        self._causes.append((timestamp_s, cause))

    def not_read(self) -> bool:
        """One is thrown away because nobody reads; whether it is the first since one was kept."""
        first, self._unread = not self._unread, True
        return first

    def keep(self, placed: Placed) -> None:
        """One is kept; those between it and the last one that was are a gap."""
        expected = 0 if self.last is None else self.last.number + 1
        cause = self._cause_before(placed)
        if placed.number > expected:
            self._gaps.append(PositionGap(expected, placed.number - expected, cause))
        self.last, self._unread = placed, False

    def before(self, number: int) -> tuple[PositionGap, ...]:
        """Return and forget the gaps before a frame."""
        gaps: list[PositionGap] = []
        while self._gaps and self._gaps[0].first_frame < number:
            gaps.append(self._gaps.popleft())
        return tuple(gaps)

    def _cause_before(self, placed: Placed) -> str:
        """Why frames before this one would be missing; what was rejected tells of its own place alone."""
        since_s, until_s = -math.inf, placed.frame.timestamp_s
        if placed.stepped:  # times before it are those of another clock
            until_s = math.inf
        elif self.last is not None:
            since_s = self.last.frame.timestamp_s
        known = [cause for at_s, cause in self._causes if since_s < at_s < until_s]
        while self._causes and self._causes[0][0] < until_s:
            self._causes.popleft()
        if self._unread:
            known.append(_UNREAD)
        return ("; ".join(dict.fromkeys(known)) or _MISSING) + ("" if placed.certain else _NOT_CERTAIN)
