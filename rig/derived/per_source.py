"""Everything that is derived from one origin: settled once, then block by block."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from math import nan

import numpy as np
from numpy.typing import NDArray

from daq.angle.cycles import Cycles, MarkerCycles
from daq.block import BLIND, SampleBlock, sample_time_ns, values_of
from daq.log.reader import CRANK_SPEED, Origin, derived_name
from daq.log.records import Impact
from daq.signals.impact_events import BounceGrouper, ImpactDetector, ImpactEvents
from rig.derived import settings as rule
from rig.derived.series import CrankSpeed, CycleFigures
from rig.stream import Consumer
from sim_twin.rigs.channel_table import Role

_LOOK_S = 0.5


class ImpactWatch:
    """Finds the impacts of a channel in its blocks; each is handed on once it is over and its phase known.

    A contact that missing samples or the end of the record cut counts as far as it was seen. Samples wait
    until there are `look_s` of them: together they take little longer than one block.
    """

    def __init__(
        self,
        origin: str,
        name: str,
        settings: rule.Settings,
        cycles: Cycles | None,
        sample_rate: float,
        start_ns: int,
        look_s: float = _LOOK_S,
        spend: Callable[..., None] = lambda **_: None,
    ) -> None:
        self._origin, self._name, self._look_s, self._spend = origin, name, look_s, spend
        self._levels, self._within_s = settings.levels[name], settings.within_s[name]
        self._cycles, self._rate, self._start_ns = cycles, sample_rate, start_ns
        self._waiting: deque[Impact] = deque()
        self._unseen: list[NDArray[np.floating]] = []
        self._base = self._next = 0
        self._begin()

    def add(self, block: SampleBlock, publish: Consumer) -> None:
        if block.first_sample != self._next:
            self._end()
            self._base = block.first_sample
            self._begin()
        self._unseen.append(block.values)
        self._next = block.end_sample
        if sum(map(len, self._unseen)) >= self._look_s * self._rate:
            self._look()
            self._tell(publish)

    def finish(self, publish: Consumer) -> None:
        self._end()
        self._tell(publish)

    def _begin(self) -> None:
        rings_s = rule.rings_s(self._name)
        self._detector = ImpactDetector(self._levels, self._rate, self._within_s, rings_s)
        self._grouper = BounceGrouper(self._rate, self._within_s)

    def _look(self) -> None:
        """Search the blocks that came since the last time."""
        if self._unseen:
            impacts = self._detector.add(np.concatenate(self._unseen))
            self._note(self._grouper.add(impacts, self._detector.settled))
            self._unseen.clear()

    def _end(self) -> None:
        self._look()
        self._note(self._grouper.add(self._detector.finish(), self._detector.settled))
        self._note(self._grouper.finish())

    def _note(self, events: ImpactEvents) -> None:
        self._spend(records=len(events))
        for row in range(len(events)):
            start = self._base + int(events.start[row])
            impact = Impact(
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
            self._waiting.append(impact)

    def _tell(self, publish: Consumer) -> None:
        while self._waiting:
            impact = self._waiting[0]
            if self._cycles is not None:
                if impact.first_sample >= self._cycles.begins.until:
                    return
                impact = replace(impact, turns=self._cycles.turns_at(impact.first_sample))
            publish(impact)
            self._waiting.popleft()


_LONGEST_GAP_S = 3600.0
"""Whoever comes later than that is not waited for: a damaged index must not take all time."""
_A_BEGIN = 256
"""Bytes unpacked in the time that takes a begin of a cycle which nobody has recorded."""


class OriginDeriver:
    """Derives from the blocks of one origin, whichever way they are cut and their channels interleaved.

    Until `settings` are there (given, or settled by the rule on the first seconds) blocks wait here, and
    until those of the `measured` origin are, whose levels go before. `nominal` is None where no scenario says
    how the rig turns: then there are impacts only, without phase. `spend` as in `Derivation`.
    """

    def __init__(
        self,
        origin: Origin,
        channels: Iterable[str],
        nominal: rule.Nominal | None,
        settings: rule.Settings | None = None,
        measured: OriginDeriver | None = None,
        spend: Callable[..., None] = lambda **_: None,
    ) -> None:
        self.origin, self.settings = origin, settings
        self._measured, self._spend = measured, spend
        self._names = tuple(channels)
        self._nominal = nominal
        self._reference = rule.reference_of(self._names) if nominal is not None else None
        self._watched = tuple(
            name for name in self._names if rule.role_of(name) in (Role.CONTACT, Role.VIBRATION)
        )
        self._waiting: list[SampleBlock] = []
        self._ends = dict.fromkeys((*self._watched, *((self._reference,) if self._reference else ())), 0)
        self._cycles: Cycles | None = None
        self._speed: CrankSpeed | None = None
        self._impacts: dict[str, ImpactWatch] = {}
        self._figures: dict[str, CycleFigures] = {}
        self._next: dict[str, int] = {}
        self._ready = False

    def add(self, block: SampleBlock, publish: Consumer) -> None:
        """Take the next block of a channel; one that nothing is derived from may lie on another grid."""
        if block.channel not in self._ends and not rule.has_figures(block.channel):
            return
        if self._ready:
            self._derive(block, publish)
            return
        self._spend(unpacked=2 * block.values.nbytes, records=1)  # and what is settled on it
        self._waiting.append(block)
        if block.channel in self._ends:
            self._ends[block.channel] = block.end_sample
        needed = round(self._settle_s * block.sample_rate)
        seen_enough = min(self._ends.values(), default=needed) >= needed or block.end_sample >= 2 * needed
        levels_known = self._measured is None or self._measured.settings is not None
        if self.settings is not None or (seen_enough and levels_known):
            self._set_up(publish)

    def finish(self, publish: Consumer) -> None:
        if not self._ready and self._waiting:
            self._set_up(publish)
        if self._cycles is not None:
            self._cycles.finish()
        if self._speed is not None:
            self._speed.finish(publish)
        for figures in self._figures.values():
            figures.finish(publish)
        for impacts in self._impacts.values():
            impacts.finish(publish)

    @property
    def _settle_s(self) -> float:
        return self._nominal.settle_s if self._nominal is not None else 1.0

    @property
    def _cycle_hz(self) -> float:
        return (self.settings.cycle_hz or 0.0) if self.settings is not None else 0.0

    def _set_up(self, publish: Consumer) -> None:
        if self.settings is None:
            seen = {name: self._first_seconds(name) for name in self._watched}
            cycle_hz, phase = None, 0.0
            if self._reference is not None and self._nominal is not None:
                values = self._first_seconds(self._reference)
                cycle_hz, phase = rule.first_look(
                    self._reference, values, self._waiting[0].sample_rate, self._nominal
                )
            known = None if self._measured is None else self._measured.settings
            rate, levels = self._waiting[0].sample_rate, {} if known is None else known.levels
            self.settings = rule.settled(self._settle_s, cycle_hz, phase, seen, rate, levels)
        self._ready = True
        waiting, self._waiting = self._waiting, []
        for block in waiting:
            self._derive(block, publish)

    def _first_seconds(self, name: str) -> NDArray[np.floating]:
        """Samples of a channel up to `settle_s`, NaN where they are missing."""
        end = round(self._settle_s * self._waiting[0].sample_rate)
        blocks = [block for block in self._waiting if block.channel == name and block.first_sample < end]
        end = min(max((block.end_sample for block in blocks), default=0), end)
        self._spend(held=max(end - sum(map(len, blocks)), 0) * np.dtype(np.float64).itemsize)  # of no block
        return values_of(blocks, 0, end)

    def _derive(self, block: SampleBlock, publish: Consumer) -> None:
        name = block.channel
        expected = self._next.get(name)
        if expected is None:
            self._begin(name, block)
            expected = 0
        if not expected <= block.first_sample <= expected + _LONGEST_GAP_S * block.sample_rate:
            return
        self._next[name] = block.end_sample
        if name == self._reference and self._cycles is not None:
            hole_s = (block.first_sample - expected) / block.sample_rate
            self._spend(unpacked=round(_A_BEGIN * hole_s * self._cycle_hz))
            self._cycles.add(block.first_sample, block.values, not block.flags & BLIND)
            if self._speed is not None:
                self._speed.add(block, publish)
        if name in self._figures:
            self._figures[name].add(block, publish)
        if name in self._impacts:
            self._impacts[name].add(block, publish)

    def _begin(self, name: str, block: SampleBlock) -> None:
        """Set up what is derived from a channel, of which this is the first block."""
        settings, rate = self.settings, block.sample_rate
        if settings is None or name not in self._names:
            return
        start_ns = sample_time_ns(block.time_ns, -block.first_sample, rate)
        if self._reference is not None and self._cycles is None:
            nominal = self._nominal
            told = () if nominal is None else (nominal.beside, nominal.mark_rad)
            self._cycles = rule.cycles_of(self._reference, settings, rate, *told)
        if name == self._reference and rule.role_of(name) is not Role.DRIVE and self._cycles is not None:
            marker = self._cycles if isinstance(self._cycles, MarkerCycles) else None
            self._speed = CrankSpeed(derived_name(self.origin, CRANK_SPEED), marker, rate, start_ns)
        if self._cycles is not None and settings.cycle_hz is not None and rule.has_figures(name):
            series = derived_name(self.origin, name)
            self._figures[name] = CycleFigures(series, self._cycles, settings.cycle_hz, rate, start_ns)
        if name in settings.levels:
            self._impacts[name] = ImpactWatch(
                self.origin, name, settings, self._cycles, rate, start_ns, spend=self._spend
            )
