"""How near the channels of a card come to the ends of their ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivers.protocols.card import CardReading


class Levels:
    """Takes readings of the channels `names`; `ranges` are those that have one, in the channel's unit."""

    def __init__(self, names: Sequence[str], ranges: Mapping[str, float]) -> None:
        self._rows = [row for row, name in enumerate(names) if name in ranges]
        self._names = [names[row] for row in self._rows]
        self._ranges = np.array([ranges[name] for name in self._names])
        self.begin()

    def begin(self) -> None:
        """Forget what has been reached so far."""
        self._shares = np.zeros(len(self._rows))

    def take(self, reading: CardReading) -> None:
        if self._rows:
            reached = np.abs(reading.values[self._rows]).max(axis=1) / self._ranges
            self._shares = np.fmax(self._shares, reached)

    def worst(self) -> str:
        """The channel that has come nearest to its range, in words; nothing where none has one."""
        if not self._rows:
            return ""
        row = int(np.argmax(self._shares))
        return f"{self._names[row]} at {100 * self._shares[row]:.0f} % of its range"
