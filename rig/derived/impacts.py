"""Impacts of one channel, with the phase at which they begin."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields
from math import nan

import numpy as np
from numpy.typing import NDArray

from daq.angle.begins import Cycles
from daq.block import SampleBlock, sample_time_ns
from daq.log.records import Impact
from daq.signals.impact_events import BounceGrouper, ImpactDetector, ImpactEvents
from rig.derived.roles import role_of
from rig.derived.settings import Settings, magnitude
from rig.stream import Consumer

_LOOK_S = 0.5


class ImpactWatch:
    """Finds the impacts of a channel in its blocks; each is handed on once it is over and its phase known.

    A contact that missing samples or the end of the record cut counts as far as it was seen.
    """

    def __init__(
        self,
        origin: str,
        name: str,
        settings: Settings,
        cycles: Cycles | None,
        sample_rate: float,
        start_ns: int,
    ) -> None:
        self._origin, self._name, self._role = origin, name, role_of(name)
        self._levels, self._within_s = settings.levels[name], settings.within_s[name]
        self._cycles, self._rate, self._start_ns = cycles, sample_rate, start_ns
        self._waiting: deque[tuple[int, _Event]] = deque()
        self._unseen: list[NDArray[np.floating]] = []
        self._base = self._next = 0
        self._detector = ImpactDetector(self._levels, self._rate)
        self._grouper = BounceGrouper(self._rate, self._within_s)

    def add(self, block: SampleBlock, publish: Consumer) -> None:
        """Take the channel's next block."""
        if block.first_sample != self._next:
            self._end()
            self._base = block.first_sample
            self._detector = ImpactDetector(self._levels, self._rate)
            self._grouper = BounceGrouper(self._rate, self._within_s)
        self._unseen.append(block.values)
        self._next = block.end_sample
        if sum(map(len, self._unseen)) >= _LOOK_S * self._rate:
            self._look()
            self._tell(publish)

    def finish(self, publish: Consumer) -> None:
        """Take the record for ended."""
        self._end()
        self._tell(publish)

    def _look(self) -> None:
        """Search the blocks that came since the last time: together they take little longer than one."""
        if self._unseen:
            impacts = self._detector.add(magnitude(self._role, np.concatenate(self._unseen)))
            self._note(self._grouper.add(impacts, self._detector.settled))
            self._unseen.clear()

    def _end(self) -> None:
        self._look()
        self._note(self._grouper.add(self._detector.finish(), self._detector.settled))
        self._note(self._grouper.finish())

    def _note(self, events: ImpactEvents) -> None:
        if len(events):
            columns = (getattr(events, name).tolist() for name in _COLUMNS)
            self._waiting.extend((self._base, _Event(*row)) for row in zip(*columns, strict=True))

    def _tell(self, publish: Consumer) -> None:
        while self._waiting:
            base, event = self._waiting[0]
            start, turns = base + event.start, nan
            if self._cycles is not None:
                if start >= self._cycles.begins.until:
                    return
                turns = self._cycles.turns_at(start)
            publish(
                Impact(
                    sample_time_ns(self._start_ns, start, self._rate),
                    self._origin,
                    self._name,
                    first_sample=start,
                    end_sample=base + event.end,
                    peak_sample=base + event.index,
                    peak=event.peak_n,
                    first_peak=event.first_n,
                    impulse=event.impulse_ns,
                    contact_s=event.contact_s,
                    bounces=event.contacts - 1,
                    turns=turns,
                )
            )
            self._waiting.popleft()


@dataclass(frozen=True, slots=True)
class _Event:
    """A row of `ImpactEvents`."""

    index: int
    start: int
    end: int
    first_n: float
    peak_n: float
    impulse_ns: float
    contact_s: float
    contacts: int


_COLUMNS = tuple(field.name for field in fields(_Event))
