"""Uniform derived channels: rms and peak of each cycle of a channel, the speed of a crank."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.angle.cycles import Cycles, MarkerCycles
from daq.angle.speed import AngleSpeed, MarkerSpeed, Run, samples_per_speed
from daq.block import BLIND, NS_PER_S, Flag, SampleBlock
from daq.log.reader import CYCLE_PEAK, CYCLE_RMS
from daq.signals.running_figures import CycleScanner
from rig.stream import Block, Consumer

_CYCLES_BLOCK_S = 1.0
_LOOK_S = 0.5
_NO_SAMPLES = np.empty(0, np.float32)
_UNKNOWN = (nan, nan)
_SPEED_BLOCK_S = 0.5


class Series:
    """Uniform series side by side, handed on in blocks of `per_block` values: then the log has few of them.

    `sample_rate` is theirs, `source_rate` that of the samples which they are computed from, whose sample 0 is
    at `start_ns`. Values that are left out begin a new block, which says so.
    """

    def __init__(
        self, channels: Sequence[str], sample_rate: float, per_block: int, source_rate: float, start_ns: int
    ) -> None:
        self._channels, self._rate, self._per_block = tuple(channels), sample_rate, per_block
        self._source_rate, self._start_ns = source_rate, start_ns
        self._first = self._next = 0
        self._sample = 0.0
        self._rows: list[Sequence[float]] = []

    def add(self, index: int, sample: float, values: Sequence[float], publish: Consumer) -> None:
        """Add value number `index` of each channel, which lies at `sample` of the source."""
        if self._rows and index != self._first + len(self._rows):
            self.flush(publish)
        if not self._rows:
            self._first, self._sample = index, sample
        self._rows.append(values)
        if len(self._rows) == self._per_block:
            self.flush(publish)

    def flush(self, publish: Consumer) -> None:
        if not self._rows:
            return
        columns = np.array(self._rows, dtype=np.float32).T
        missing = Flag.GOOD if self._first == self._next else Flag.SAMPLES_MISSING_BEFORE
        time_ns = self._start_ns + round(self._sample * NS_PER_S / self._source_rate)
        for channel, column in zip(self._channels, columns, strict=True):
            values = np.ascontiguousarray(column)
            flags = missing | (Flag.GOOD if np.isfinite(values).all() else Flag.NOT_FINITE)
            block = SampleBlock(channel, self._first, time_ns, self._rate, values, flags)
            publish(Block("derived", block))
        self._next = self._first + len(self._rows)
        self._rows = []


class _Stretch(NamedTuple):
    """Consecutive samples that are all good, or in blocks that are not."""

    first_sample: int
    values: NDArray[np.floating]
    good: bool

    @property
    def end_sample(self) -> int:
        return self.first_sample + len(self.values)

    def since(self, sample: int) -> _Stretch:
        """What of it comes from a sample on; nothing before that is kept."""
        if sample <= self.first_sample:
            return self
        return _Stretch(sample, self.values[sample - self.first_sample :].copy(), self.good)


class CycleFigures:
    """Figures of the cycles of one channel; sample 0 of the series is the first whole cycle of the record.

    A cycle with a block that is overloaded, open or not finite, or with samples missing, is NaN. Blocks
    wait here until it is known where cycles begin in them. `start_ns` is the time of sample 0.
    """

    def __init__(self, name: str, cycles: Cycles, cycle_hz: float, sample_rate: float, start_ns: int) -> None:
        self._begins, self._rate = cycles.begins, sample_rate
        per_block = max(round(_CYCLES_BLOCK_S * cycle_hz), 1)
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
        groups: list[list[_Stretch]] = []
        for each in self._waiting:
            if groups and groups[-1][-1].end_sample == each.first_sample and groups[-1][0].good == each.good:
                groups[-1].append(each)
            else:
                groups.append([each])
        self._waiting, self._unseen = [], 0
        waiting = [
            _Stretch(group[0].first_sample, np.concatenate([each.values for each in group]), group[0].good)
            for group in groups
        ]
        for number, stretch in enumerate(waiting):
            if not self._take(stretch, publish):
                self._waiting = [stretch.since(self._next), *waiting[number + 1 :]]
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
                if self._running is not None and self._begins.first_number is not None:
                    sample, ended_number = self._running
                    index = ended_number - self._begins.first_number
                    self._series.add(index, sample, figures if sound and good else _UNKNOWN, publish)
                self._running = self._next + offset, number
        if not good:
            self._scanner.spoil()
        self._next = end


class CrankSpeed:
    """Speed from the reference channel of a crank: an encoder's angle, or `marker` where it has none.

    The device's rate may be no multiple of 50 Hz: the series has the rate that whole samples allow, and the
    time of a value is the middle of its samples. `start_ns` is the time of sample 0.
    """

    def __init__(self, name: str, marker: MarkerCycles | None, sample_rate: float, start_ns: int) -> None:
        self._every = samples_per_speed(sample_rate)
        rate = sample_rate / self._every
        self._series = Series([name], rate, max(round(_SPEED_BLOCK_S * rate), 1), sample_rate, start_ns)
        self._angle = AngleSpeed(sample_rate, self._every) if marker is None else None
        self._marker = None if marker is None else MarkerSpeed(marker, sample_rate, self._every)
        self._end = 0

    def add(self, block: SampleBlock, publish: Consumer) -> None:
        """Take the reference channel's next block, which its cycles have seen."""
        self._end = block.end_sample
        if self._angle is not None:
            self._note(self._angle.add(block.first_sample, block.values), publish)
        self._take(publish)

    def finish(self, publish: Consumer) -> None:
        self._take(publish)
        self._series.flush(publish)

    def _take(self, publish: Consumer) -> None:
        if self._marker is not None:
            self._note(self._marker.take(self._end), publish)

    def _note(self, runs: list[Run], publish: Consumer) -> None:
        for first, speeds in runs:
            for index, speed in enumerate(speeds.tolist(), first):
                self._series.add(index, index * self._every + (self._every - 1) / 2, [speed], publish)
