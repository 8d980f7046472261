"""A condition that counts only once it lasts, and is over only once that lasts."""

from __future__ import annotations

BACK_S = 0.15
"""How long it must be gone to count as over: more than two of a card's readings, which come every 0.1 s."""


class Held:
    """Tells whether something has held for `hold_s`; a lapse shorter than 0.15 s does not end it.

    So one reading proves nothing, and neither does a value that chatters about a limit begin anew each time.
    All times are of one clock, whichever.
    """

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self._since_s: float | None = None
        self._gone_s: float | None = None

    @property
    def began(self) -> bool:
        """Whether it holds, be it for how short."""
        return self._since_s is not None

    def look(self, at_s: float, *, holds: bool, gone: bool) -> float | None:
        """Take a reading; how long it has held, in s, once that is `hold_s`, else None.

        A reading may be neither: within the hysteresis, or no reading at all. It changes nothing.
        """
        if holds:
            self._gone_s = None
            self._since_s = at_s if self._since_s is None else self._since_s
            held_s = at_s - self._since_s
            return held_s if held_s >= self._hold_s else None
        if gone:
            self._gone_s = at_s if self._gone_s is None else self._gone_s
            if at_s - self._gone_s >= BACK_S:
                self._since_s = None
        return None
