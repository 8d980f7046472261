"""Holds measured data back until the prediction for it is there, so that both appear together."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Collection
from typing import Generic, TypeVar

from daq.log.reader import Origin

Item = TypeVar("Item")


class OverlayOrder(Generic[Item]):
    """Items in order of time (s), given out once both origins have come so far.

    The twin needs a moment longer than the sensors. Nothing waits longer than `patience_s` behind the newest
    item, so that a twin which is late or silent delays the view and does not stop it. `expected` are the
    origins that have channels. Items come out in lots that are `step_s` of data apart.
    """

    def __init__(self, expected: Collection[Origin], patience_s: float, step_s: float = 0.0) -> None:
        self._patience_s = patience_s
        self._step_s = step_s
        self._given_s = -math.inf
        self._newest: dict[Origin, float] = dict.fromkeys(expected, -math.inf)
        self._count = itertools.count()
        self._waiting: list[tuple[float, int, Item]] = []

    def note(self, origin: Origin, time_s: float) -> None:
        """Say that `origin` has come to `time_s`."""
        self._newest[origin] = max(self._newest.get(origin, -math.inf), time_s)

    def add(self, time_s: float, item: Item) -> None:
        """Keep an item that belongs to `time_s`."""
        heapq.heappush(self._waiting, (time_s, next(self._count), item))

    def ready(self) -> list[Item]:
        """Take out what both origins have reached, oldest first; nothing before another `step_s` has come."""
        newest = self._newest.values()
        reached = max(min(newest), max(newest) - self._patience_s)
        if reached < self._given_s + self._step_s:
            return []
        self._given_s = reached
        return self._take(reached)

    def rest(self) -> list[Item]:
        """Take out everything, oldest first."""
        return self._take(math.inf)

    def _take(self, until_s: float) -> list[Item]:
        taken = []
        while self._waiting and self._waiting[0][0] <= until_s:
            taken.append(heapq.heappop(self._waiting)[2])
        return taken
