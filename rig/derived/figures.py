"""Rms and peak of each cycle of a channel as two derived channels."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.angle.begins import Cycles
from daq.block import BLIND, SampleBlock
from daq.derived_names import CYCLE_PEAK, CYCLE_RMS
from daq.signals.running_figures import CycleScanner
from rig.derived.series import Series
from rig.stream import Consumer

_BLOCK_S = 1.0
_LOOK_S = 0.5
_NO_SAMPLES = np.empty(0, np.float32)
_UNKNOWN = (nan, nan)


class _Stretch(NamedTuple):
    """Consecutive samples that are all good, or in blocks that are not."""

    first_sample: int
    values: NDArray[np.floating]
    good: bool

    @property
    def end_sample(self) -> int:
        return self.first_sample + len(self.values)


def _joined(stretches: Sequence[_Stretch]) -> list[_Stretch]:
    groups: list[list[_Stretch]] = []
    for each in stretches:
        if groups and groups[-1][-1].end_sample == each.first_sample and groups[-1][0].good == each.good:
            groups[-1].append(each)
        else:
            groups.append([each])
    return [
        _Stretch(group[0].first_sample, np.concatenate([each.values for each in group]), group[0].good)
        for group in groups
    ]


class CycleFigures:
    """Figures of the cycles of one channel; sample 0 of the series is the first whole cycle of the record.

    A cycle with a block that is overloaded, open or not finite, or with samples missing, is NaN. Blocks
    wait here until it is known where cycles begin in them. `start_ns` is the time of sample 0.
    """

    def __init__(self, name: str, cycles: Cycles, cycle_hz: float, sample_rate: float, start_ns: int) -> None:
        self._begins, self._rate = cycles.begins, sample_rate
        per_block = max(round(_BLOCK_S * cycle_hz), 1)
        names = f"{name}.{CYCLE_RMS}", f"{name}.{CYCLE_PEAK}"
        self._series = Series(names, cycle_hz, per_block, sample_rate, start_ns)
        self._scanner = CycleScanner()
        self._waiting: list[_Stretch] = []
        self._unseen = 0
        self._next = 0
        self._running: tuple[int, int] | None = None

    def add(self, block: SampleBlock, publish: Consumer) -> None:
        """Take the channel's next block; hand on what has become certain, twice a second."""
        self._waiting.append(_Stretch(block.first_sample, block.values, not block.flags & BLIND))
        self._unseen += len(block)
        if self._unseen >= _LOOK_S * self._rate:
            self._look(publish)

    def finish(self, publish: Consumer) -> None:
        """Take what waits, and the last cycle if the record ends where it does: no more begins will come."""
        self._look(publish)
        self._advance(self._next + 1, _NO_SAMPLES, True, publish)
        self._series.flush(publish)

    def _look(self, publish: Consumer) -> None:
        """Several blocks together take little longer than one."""
        waiting, self._waiting, self._unseen = _joined(self._waiting), [], 0
        for number, stretch in enumerate(waiting):
            if not self._take(stretch, publish):
                self._waiting = waiting[number:]
                return

    def _take(self, stretch: _Stretch, publish: Consumer) -> bool:
        """Take a stretch as far as begins are known in it; True if that is all of it."""
        if self._next < stretch.first_sample:
            if self._begins.until < stretch.first_sample:
                return False
            self._advance(stretch.first_sample, _NO_SAMPLES, False, publish)
        end = min(stretch.end_sample, self._begins.until)
        if self._next < end:
            values = stretch.values[self._next - stretch.first_sample : end - stretch.first_sample]
            self._advance(end, values, stretch.good, publish)
        return self._next >= stretch.end_sample

    def _advance(self, end: int, values: NDArray[np.floating], good: bool, publish: Consumer) -> None:
        """Go on to sample `end` with the samples up to there; those that are no good spoil their cycles."""
        begins = self._begins.between(self._next, end)
        if not good:
            self._scanner.spoil()
        ended = self._scanner.add(values, begins.offset if len(values) else begins.offset * 0)
        if begins.number:
            rows = zip(begins.offset.tolist(), begins.number, begins.sound, ended.tolist(), strict=True)
            for offset, number, sound, figures in rows:
                self._end_cycle(figures if sound and good else _UNKNOWN, publish)
                self._running = self._next + offset, number
        if not good:
            self._scanner.spoil()
        self._next = end

    def _end_cycle(self, figures: Sequence[float], publish: Consumer) -> None:
        if self._running is not None and self._begins.first_number is not None:
            sample, number = self._running
            self._series.add(number - self._begins.first_number, sample, figures, publish)
