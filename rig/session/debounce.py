"""A condition that counts only once it lasts, and is over only once its end lasts."""

from __future__ import annotations

import math

BACK_S = 0.15
"""How long it must be gone to count as over: more than two of a card's readings, which come every 0.1 s."""


class Debounced:
    """Tells whether something has held for `hold_s`.

    It is over once it has been gone for 0.15 s, or once readings of which none showed it have lasted for
    `hold_s`. So a wrong reading now and then proves nothing, and a value that chatters about a limit does not
    begin anew each time. All times are of one clock, whichever.
    """

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self._since_s: float | None = None
        self._gone_s: float | None = None
        self._latest_s, self._lapsed = -math.inf, False

    @property
    def since_s(self) -> float | None:
        """Since when it holds, be it for how short; None while it does not."""
        return self._since_s

    def look(self, at_s: float, *, holds: bool, gone: bool) -> float | None:
        """Take a reading; how long it has held, in s, once that is `hold_s`, else None.

        A reading may be neither: within the hysteresis, or no value at all.
        """
        self._lapsed |= not holds
        if self._lapsed and at_s - self._latest_s >= self._hold_s:
            self._since_s = None
        if holds:
            self._gone_s, self._latest_s, self._lapsed = None, at_s, False
            self._since_s = at_s if self._since_s is None else self._since_s
            held_s = at_s - self._since_s
            return held_s if held_s >= self._hold_s else None
        if gone:
            self._gone_s = at_s if self._gone_s is None else self._gone_s
            if at_s - self._gone_s >= BACK_S:
                self._since_s = None
        return None
