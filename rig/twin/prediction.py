"""The twin of a run in step with its measurement, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock, as_logged, sample_time_ns
from rig.stream import Shape
from rig.twin.alignment import Alignment
from sim_twin.rigs.channel_table import ENCODER_ANGLE
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after
from sim_twin.sensors import Encoder, SensorChain
from sim_twin.stream import TwinStream
from sim_twin.twin import AnyTwin

_LEAST_SETTLE_S = 1.0
_DROOP_TIMES = 5.0
"""Time constants after which a charge amplifier is in steady state to under a percent."""
BLOCK_S = 0.2
"""At most; of a run, what has been measured meanwhile."""
_GOLDEN = (5**0.5 - 1) / 2
"""Steps of so many cycles come to every phase evenly, however few they are."""


def settling_s(twin: AnyTwin, settle_s: float) -> float:
    """Seconds that a twin runs before sample 0: `settle_s`, or until motion and droops are steady."""
    chains = [sensor for sensor in twin.sensors.values() if isinstance(sensor, SensorChain)]
    corners = [chain.droop_corner for chain in chains if chain.droop_corner is not None]
    corners += [corner for chain in chains if chain.stages is not None for corner in chain.stages.high_passes]
    droop_s = _DROOP_TIMES / (2 * np.pi * min(corners)) if corners else 0.0
    return max(settle_s, _LEAST_SETTLE_S, droop_s)


def skip(stream: TwinStream, count: int) -> None:
    """Advance by `count` samples that nobody wants."""
    most = max(1, round(BLOCK_S * stream.sample_rate))
    for first in range(0, count, most):
        stream.advance(min(most, count - first))


def blocks_of(
    stream: TwinStream | AlignedTwin, first_sample: int, end_sample: int, start_ns: int
) -> Iterator[SampleBlock]:
    """Blocks of at most 0.2 s of every channel from where `stream` is; `start_ns` is the time of sample 0."""
    most = max(1, round(BLOCK_S * stream.sample_rate))
    for first in range(first_sample, end_sample, most):
        values = stream.advance(min(most, end_sample - first))
        time_ns = sample_time_ns(start_ns, first, stream.sample_rate)
        for name, row in zip(stream.channels, values, strict=True):
            yield SampleBlock(name, first, time_ns, stream.sample_rate, as_logged(name, row))


def _sent(
    encoder: Encoder, drive: SpeedDrive, at_zero: float, rate: float, first: int, end: int, start_ns: int
) -> SampleBlock:
    """What an encoder beside the card would send at its samples, less the turns before the first of all."""
    times = np.arange(first, end) / rate
    turned = at_zero + drive.speed * times
    if drive.fluctuation:
        turned = np.array([angle_after(drive, at_zero, time) for time in times])
    turns = np.floor(encoder.sent(np.array([at_zero]))[0] / (2 * np.pi))
    values = encoder.sent(turned) - 2 * np.pi * turns
    return SampleBlock(ENCODER_ANGLE.name, first, sample_time_ns(start_ns, first, rate), rate, values)


class AlignedTwin:
    """Predicted samples of every channel on the sample grid of a run.

    A drive that was running before sample 0 has been running in the twin too (`settling_s`);
    one that began within the record begins there in the twin, from rest.
    """

    def __init__(self, twin: AnyTwin, alignment: Alignment, sample_rate: float, settle_s: float) -> None:
        self.sample_rate = sample_rate
        self._stream = twin.model.stream(twin, sample_rate)
        drive = twin.drive.at_cycle_hz(alignment.frequency)
        self.samples = self._before = self._looks = 0
        self._cycle = sample_rate / drive.cycle_hz
        self._beside = None
        encoder = twin.sensors.get(ENCODER_ANGLE.name)
        if isinstance(encoder, Encoder):
            at_zero = drive.phase_after(alignment.phase, alignment.frequency, 0.0)
            self._beside = partial(_sent, encoder, drive, at_zero, sample_rate)
        if alignment.onset is not None:
            phase = drive.phase_after(alignment.phase, alignment.frequency, alignment.onset / sample_rate)
            self._stream.drive(drive, phase, alignment.onset)
            return
        self._before = before = round(settling_s(twin, settle_s) * sample_rate)
        self._stream.drive(
            drive, drive.phase_after(alignment.phase, alignment.frequency, -before / sample_rate), 0.0
        )
        skip(self._stream, before)

    @property
    def channels(self) -> tuple[str, ...]:
        return self._stream.channels

    def advance(self, count: int) -> NDArray[np.float64]:
        """Next `count` samples, shape (channels, count)."""
        self._looks += 1
        # the ends of whole cycles are all alike
        after = int(self._looks * _GOLDEN % 1.0 * min(self._cycle, count))
        values = self._stream.advance(count - after)
        time_s, points = self._stream.shape()
        self._seen = Shape(time_s - self._before / self.sample_rate, points)
        self.samples += count
        return np.concatenate((values, self._stream.advance(after)), axis=1) if after else values

    def blocks(self, end_sample: int, start_ns: int) -> Iterator[SampleBlock]:
        """Blocks of every channel up to `end_sample`; `start_ns` is the time of sample 0."""
        first = self.samples
        yield from blocks_of(self, first, end_sample, start_ns)
        if self._beside is not None and end_sample > first:
            yield self._beside(first, end_sample, start_ns)

    def shape(self) -> Shape:
        """Where its rig was during the last `advance`, at another phase of the cycle each time."""
        return self._seen
