"""The channel crank.speed of one origin, in rpm at 50 values a second."""

from __future__ import annotations

from daq.angle.crank_cycles import MarkerCycles
from daq.angle.speed import AngleSpeed, MarkerSpeed, Run, samples_per_speed
from daq.block import SampleBlock
from rig.derived.series import Series
from rig.stream import Consumer

_BLOCK_S = 0.5


class CrankSpeed:
    """Speed from the reference channel of a crank: an encoder's angle, or `marker` where it has none.

    The device's rate may be no multiple of 50 Hz: the series has the rate that whole samples allow, and the
    time of a value is the middle of its samples. `start_ns` is the time of sample 0.
    """

    def __init__(self, name: str, marker: MarkerCycles | None, sample_rate: float, start_ns: int) -> None:
        self._every = samples_per_speed(sample_rate)
        rate = sample_rate / self._every
        self._series = Series([name], rate, max(round(_BLOCK_S * rate), 1), sample_rate, start_ns)
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
        """Hand on what waits."""
        self._take(publish)
        self._series.flush(publish)

    def _take(self, publish: Consumer) -> None:
        if self._marker is not None:
            self._note(self._marker.take(self._end), publish)

    def _note(self, runs: list[Run], publish: Consumer) -> None:
        for first, speeds in runs:
            for index, speed in enumerate(speeds.tolist(), first):
                self._series.add(index, index * self._every + (self._every - 1) / 2, [speed], publish)
