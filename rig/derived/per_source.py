"""Everything that is derived from one origin: settled once, then block by block."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from daq.angle.begins import Cycles
from daq.angle.crank_cycles import MarkerCycles
from daq.block import BLIND, SampleBlock, sample_time_ns
from daq.derived_names import CRANK_SPEED, derived_name
from daq.log.reader import Origin
from rig.derived.impacts import ImpactWatch
from rig.derived.reference import Nominal, cycles_of, first_look
from rig.derived.roles import DRIVE, reference_of, role_of
from rig.derived.series import CrankSpeed, CycleFigures
from rig.derived.settings import Settings, settled
from rig.stream import Consumer

_LONGEST_GAP_S = 3600.0
"""Whoever comes later than that is not waited for: a damaged index must not take all time."""


class OriginDeriver:
    """Derives from the blocks of one origin, whichever way they are cut and their channels interleaved.

    Until `settings` are there (given, or settled by the rule on the first seconds) blocks wait here.
    `nominal` is None where no scenario says how the rig turns: then there are impacts only, without phase.
    """

    def __init__(
        self,
        origin: Origin,
        channels: Iterable[str],
        nominal: Nominal | None,
        settings: Settings | None = None,
    ) -> None:
        self.origin, self.settings = origin, settings
        self._names = tuple(channels)
        self._nominal = nominal
        self._reference = reference_of(self._names) if nominal is not None else None
        self._watched = tuple(name for name in self._names if role_of(name).watch is not None)
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
        if block.channel not in self._ends and not role_of(block.channel).has_figures:
            return
        if self._ready:
            self._derive(block, publish)
            return
        self._waiting.append(block)
        if block.channel in self._ends:
            self._ends[block.channel] = block.end_sample
        if self.settings is not None or self._seen_enough(block):
            self._set_up(publish)

    def finish(self, publish: Consumer) -> None:
        """No more blocks will come."""
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

    def _seen_enough(self, block: SampleBlock) -> bool:
        needed = round(self._settle_s * block.sample_rate)
        return min(self._ends.values(), default=needed) >= needed or block.end_sample >= 2 * needed

    @property
    def _settle_s(self) -> float:
        return self._nominal.settle_s if self._nominal is not None else 1.0

    def _set_up(self, publish: Consumer) -> None:
        if self.settings is None:
            self.settings = self._settle()
        self._ready = True
        waiting, self._waiting = self._waiting, []
        for block in waiting:
            self._derive(block, publish)

    def _settle(self) -> Settings:
        seen = {name: self._first_seconds(name) for name in self._watched}
        cycle_hz, phase = None, 0.0
        if self._reference is not None and self._nominal is not None:
            values = self._first_seconds(self._reference)
            cycle_hz, phase = first_look(self._reference, values, self._waiting[0].sample_rate, self._nominal)
        return settled(self._settle_s, cycle_hz, phase, seen)

    def _first_seconds(self, name: str) -> NDArray[np.floating]:
        """Samples of a channel up to `settle_s`, NaN where they are missing."""
        end = round(self._settle_s * self._waiting[0].sample_rate)
        blocks = [block for block in self._waiting if block.channel == name and block.first_sample < end]
        values = np.full(min(max((block.end_sample for block in blocks), default=0), end), np.nan)
        for block in blocks:
            values[block.first_sample : block.end_sample] = block.values[: end - block.first_sample]
        return values

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
            self._cycles = cycles_of(self._reference, settings, rate)
        if name == self._reference and name != DRIVE and self._cycles is not None:
            marker = self._cycles if isinstance(self._cycles, MarkerCycles) else None
            self._speed = CrankSpeed(derived_name(self.origin, CRANK_SPEED), marker, rate, start_ns)
        if self._cycles is not None and settings.cycle_hz is not None and role_of(name).has_figures:
            series = derived_name(self.origin, name)
            self._figures[name] = CycleFigures(series, self._cycles, settings.cycle_hz, rate, start_ns)
        if name in settings.levels:
            self._impacts[name] = ImpactWatch(self.origin, name, settings, self._cycles, rate, start_ns)
