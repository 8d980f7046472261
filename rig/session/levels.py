"""How near the channels of a card come to what they may reach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivers.protocols.card import CardReading
from rig.bounds import Bounds, nearest


class Levels:
    """Takes readings of the channels `names`, some of which have `bounds`."""

    def __init__(self, names: Sequence[str], bounds: Mapping[str, Bounds]) -> None:
        self._rows = [row for row, name in enumerate(names) if name in bounds]
        self._names, self._bounds = [names[row] for row in self._rows], bounds
        self.begin()

    def begin(self) -> None:
        """Forget what has been reached so far."""
        self._most = np.zeros(len(self._rows))

    def take(self, reading: CardReading) -> None:
        if self._rows:
            highest, lowest = (each.reduce(reading.values, axis=1) for each in (np.fmax, np.fmin))
            self._most = np.fmax(self._most, np.fmax(highest, -lowest)[self._rows])

    def worst(self) -> str:
        """The channel that has come nearest to its limit or range, in words; nothing where none has one."""
        levels = dict(zip(self._names, self._most.tolist(), strict=True))
        name = nearest(levels, self._bounds)
        return name and f"{name} at {self._bounds[name].said(levels[name])}"
