"""Turns of the crank at every sample, followed while a run lasts."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from daq.angle.marker import Marks, MarkTracker, crank_angle
from daq.block import SampleBlock
from daq.signals.even_angles import angle_turns, smooth_turns
from rig.stream import LastSeconds

KEPT_S = 6.0
"""Turns reach so far back; three revolutions, which a marker takes to be believed, at 30 rpm."""

_SMOOTHED_S = 4e-3
"""An encoder's steps are smoothed over this stretch: 54 counts of 4096 a revolution at 200 rpm."""

_MARKS_KEPT = 512


def turns_from(channels: tuple[str, ...], angle: str, marker: str, mark_rad: float) -> Turns | None:
    """From the encoder's `angle` if it is among `channels`, else from `marker`; None where neither is.

    The mark comes at crank angle `mark_rad`.
    """
    if angle in channels:
        return EncoderTurns(angle)
    return MarkerTurns(marker, mark_rad) if marker in channels else None


class EncoderTurns:
    """Turns from an unwrapped crank angle in rad, its steps smoothed; not known yet from `known_until` on.

    A stream that goes back in time or has a hole starts afresh after it.
    """

    def __init__(self, channel: str) -> None:
        self.channel = channel
        self.known_until = 0
        self._raw = LastSeconds(KEPT_S)
        self._turns = LastSeconds(KEPT_S)
        self._begin = 0  # of the samples without a hole

    def add(self, block: SampleBlock) -> None:
        """Take a block; turns are known up to half the smoothed stretch before its end."""
        if not np.isfinite(block.values).any():
            return
        if block.first_sample != self._raw.end_sample:
            self._begin = self.known_until = block.first_sample
            self._raw = LastSeconds(KEPT_S)
        self._raw.add(block)
        half = max(round(_SMOOTHED_S * block.sample_rate / 2), 2)
        end = block.end_sample - half
        if end - self._begin <= half:
            return
        first = self.known_until
        begin = max(first - half, self._begin)
        angle = self._raw.between(begin, end + half)
        good = np.isfinite(angle)
        if not good.all():  # a straight line in the place of samples that are no numbers
            at = np.arange(len(angle))
            angle = np.interp(at, at[good], angle[good])
        smooth = smooth_turns(angle_turns(angle), 2 * half + 1)
        settled = smooth[first - begin : end - begin]
        self._turns.add(SampleBlock(block.channel, first, 0, block.sample_rate, settled))
        self.known_until = end

    def at(self, samples: NDArray[np.int64]) -> NDArray[np.float64]:
        """Turns at sample indices that grow, shape (n,); NaN where they are not known, or no more."""
        if not len(samples):
            return np.empty(0)
        first = int(samples[0])
        return np.asarray(self._turns.between(first, int(samples[-1]) + 1)[samples - first], dtype=np.float64)


class MarkerTurns:
    """Turns from a marker in V, which comes once a revolution at crank angle `mark_rad`; between marks the
    crank turns evenly.
    """

    def __init__(self, channel: str, mark_rad: float = 0.0) -> None:
        self.channel = channel
        self._mark_rad = mark_rad
        self._restart(0)

    def _restart(self, first_sample: int) -> None:
        self._origin = self._end = first_sample
        self._tracker = MarkTracker()
        self._marks = self._tracker.track([])[0]

    def add(self, block: SampleBlock) -> None:
        if block.first_sample != self._end:
            self._restart(block.first_sample)
        self._end = block.end_sample
        found, _ = self._tracker.track(block.values)
        if len(found):
            columns = (
                np.concatenate((getattr(self._marks, field.name), getattr(found, field.name)))[-_MARKS_KEPT:]
                for field in fields(Marks)
            )
            self._marks = Marks(*columns)

    @property
    def known_until(self) -> int:
        return self._origin + (int(self._marks.position[-1]) if len(self._marks) else 0)

    def at(self, samples: NDArray[np.int64]) -> NDArray[np.float64]:
        return angle_turns(crank_angle(self._marks, samples - self._origin).angle_rad + self._mark_rad)


Turns = EncoderTurns | MarkerTurns
