"""True signals of several runs on their samples' grid, anti-aliased, before the rest of their chains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from sim_twin.decimation import decimated
from sim_twin.ensembles.simulate import Variant
from sim_twin.rigs.rig_model import Truths
from sim_twin.sensors import Encoder, anti_alias_taps
from sim_twin.status import Status
from sim_twin.stream import Truth

Array = NDArray[np.float64]
_CHUNK = 2048
"""Samples computed at once: what fits into the processor's own memory."""
_LAST_FACTOR = 2
_ATTENUATION_DB = 80.0
_PASS = 0.55
"""Of the sample rate: what the first stage of decimation leaves as it is."""


def clean_samples(
    variants: Sequence[Variant], sample_rate: float, settle: float, count: int, oversampling: int
) -> list[Array | None]:
    """`count` samples of every channel after `settle` s from rest, (channels, count); None for a failed run.

    The variants are of one rig and have the same channels. The truth is computed at `oversampling` times the
    `sample_rate` (Hz). Encoders give their angle at the sample instants, not counted.
    """
    truths = truths_of(variants, sample_rate * oversampling)
    coarse = _Stage(_taps(oversampling // _LAST_FACTOR), oversampling // _LAST_FACTOR)
    last = _Stage(anti_alias_taps(_LAST_FACTOR, 0.0), _LAST_FACTOR)
    twin = variants[0].twin
    smooth = np.array(  # read as they are
        [
            name in twin.model.smooth(twin.rig) or isinstance(twin.sensors.get(name), Encoder)
            for name in twin.channels
        ]
    )
    total = round(settle * sample_rate) + count
    parts = []
    for first in range(0, total, _CHUNK):
        wanted = min(_CHUNK, total - first)
        between = last.missing(wanted)
        moved = coarse.advance(truths.advance(coarse.missing(between)), between, smooth)
        parts.append(last.advance(moved, wanted, smooth))
    samples = np.concatenate(parts, axis=2)[:, :, total - count :]
    finished = (status is Status.COMPLETED for status in truths.statuses)
    return [one if ended else None for one, ended in zip(samples, finished, strict=True)]


def truths_of(variants: Sequence[Variant], rate: float) -> Truths:
    """Motions of some runs of one rig from rest, on a grid of `rate` Hz; together where the rig can."""
    model = variants[0].twin.model
    twins, phases = [each.twin for each in variants], [each.phase for each in variants]
    if model.side_by_side is not None:
        return model.side_by_side.truths(twins, phases, rate)
    truths = [model.truth(twin, rate, False) for twin in twins]
    for truth, each in zip(truths, variants, strict=True):
        truth.change_drive(each.twin.drive, each.phase, 0.0)
    return OneByOne(truths)


class OneByOne:
    """Motions that nothing makes faster together; rows of a failed one are filled up with zeros."""

    def __init__(self, truths: Sequence[Truth]) -> None:
        self._truths = truths

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (truths, channels, steps)."""
        moved = [truth.advance(steps) for truth in self._truths]
        return np.array([np.pad(rows, ((0, 0), (0, steps - rows.shape[1]))) for rows in moved])

    @property
    def statuses(self) -> Sequence[Status]:
        return [truth.status for truth in self._truths]


def _taps(factor: int) -> Array:
    """A first stage's taps at its input rate: all that would fall onto the last stage's pass band is gone."""
    if factor == 1:
        return np.ones(1)
    edge = _PASS / _LAST_FACTOR / factor
    count, beta = signal.kaiserord(_ATTENUATION_DB, 2 * (1 / factor - 2 * edge))
    return np.asarray(signal.firwin(count | 1, 0.5 / factor, window=("kaiser", beta), fs=1.0))


class _Stage:
    """One decimation of all signals; what the filter reaches back to is carried from part to part."""

    def __init__(self, taps: Array, factor: int) -> None:
        self.taps, self.factor = taps, factor
        self.half = len(taps) // 2
        self.held: Array | None = None

    def missing(self, count: int) -> int:
        """How many more input samples `count` outputs need."""
        held = self.half if self.held is None else self.held.shape[2]
        return (count - 1) * self.factor + len(self.taps) - held

    def advance(self, moved: Array, count: int, smooth: NDArray[np.bool_]) -> Array:
        held = np.zeros((*moved.shape[:2], self.half)) if self.held is None else self.held
        fine = np.concatenate([held, moved], axis=2)
        self.held = fine[:, :, count * self.factor :].copy()
        out = np.zeros((*fine.shape[:2], count))
        for run, channel in np.ndindex(fine.shape[:2]):
            row = fine[run, channel]
            if smooth[channel] or len(self.taps) == 1:
                out[run, channel] = row[self.half : self.half + count * self.factor : self.factor]
            elif row.any():
                out[run, channel] = decimated(row, self.taps, self.factor, count)
        return out
