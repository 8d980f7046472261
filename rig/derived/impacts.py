"""Impacts of one channel, with the phase at which they begin."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import nan

from daq.angle.begins import Cycles
from daq.block import SampleBlock, sample_time_ns
from daq.log.records import Impact
from daq.signals import BounceGrouper, ImpactDetector, ImpactEvents
from rig.derived.roles import role_of
from rig.derived.settings import Settings, magnitude

Emit = Callable[[Impact], None]


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
        self._waiting: deque[Impact] = deque()
        self._base = self._next = 0
        self._detector = ImpactDetector(self._levels, self._rate)
        self._grouper = BounceGrouper(self._rate, self._within_s)

    def add(self, block: SampleBlock, emit: Emit) -> None:
        """Take the channel's next block."""
        if block.first_sample != self._next:
            self._end()
            self._base = block.first_sample
            self._detector = ImpactDetector(self._levels, self._rate)
            self._grouper = BounceGrouper(self._rate, self._within_s)
        impacts = self._detector.add(magnitude(self._role, block.values))
        self._note(self._grouper.add(impacts, self._detector.settled))
        self._next = block.end_sample
        self._tell(emit)

    def finish(self, emit: Emit) -> None:
        """Take the record for ended."""
        self._end()
        self._tell(emit)

    def _end(self) -> None:
        self._note(self._grouper.add(self._detector.finish(), self._detector.settled))
        self._note(self._grouper.finish())

    def _note(self, events: ImpactEvents) -> None:
        for row in range(len(events)):
            start = self._base + int(events.start[row])
            self._waiting.append(
                Impact(
                    sample_time_ns(self._start_ns, start, self._rate),
                    self._origin,
                    self._name,
                    first_sample=start,
                    end_sample=self._base + int(events.end[row]),
                    peak_sample=self._base + int(events.index[row]),
                    peak=float(events.peak_n[row]),
                    first_peak=float(events.first_n[row]),
                    impulse=float(events.impulse_ns[row]),
                    contact_s=float(events.contact_s[row]),
                    bounces=int(events.contacts[row]) - 1,
                    turns=nan,
                )
            )

    def _tell(self, emit: Emit) -> None:
        while self._waiting:
            impact = self._waiting[0]
            if self._cycles is not None:
                if impact.first_sample >= self._cycles.begins.until:
                    return
                impact = _at(impact, self._cycles.turns_at(impact.first_sample))
            emit(impact)
            self._waiting.popleft()


def _at(impact: Impact, turns: float) -> Impact:
    fields = {name: getattr(impact, name) for name in Impact.__slots__}
    return Impact(**(fields | {"turns": turns}))
