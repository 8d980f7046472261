"""True signals of several runs on their samples' grid, anti-aliased, before the rest of their chains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from sim_twin.decimation import decimated
from sim_twin.ensembles.samples import truths_of
from sim_twin.ensembles.variant import Variant
from sim_twin.rigs.side_by_side import Truths
from sim_twin.sensors import Encoder, anti_alias_taps
from sim_twin.status import Status

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
    stages = [_Stage(_taps(oversampling // _LAST_FACTOR), oversampling // _LAST_FACTOR)]
    stages.append(_Stage(anti_alias_taps(_LAST_FACTOR, 0.0), _LAST_FACTOR))
    smooth = _smooth(variants)
    total = round(settle * sample_rate) + count
    parts = []
    for first in range(0, total, _CHUNK):
        parts.append(_advanced(truths, stages, smooth, min(_CHUNK, total - first)))
    samples = np.concatenate(parts, axis=2)[:, :, total - count :]
    finished = (status is Status.COMPLETED for status in truths.statuses)
    return [one if ended else None for one, ended in zip(samples, finished, strict=True)]


def _smooth(variants: Sequence[Variant]) -> NDArray[np.bool_]:
    """Which channels are read as they are."""
    twin = variants[0].twin
    smooth = twin.model.smooth_channels
    encoders = (isinstance(twin.sensors.get(name), Encoder) for name in twin.channels)
    return np.array([name in smooth or one for name, one in zip(twin.channels, encoders, strict=True)])


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
            self._decimate(fine[run, channel], bool(smooth[channel]), out[run, channel])
        return out

    def _decimate(self, fine: Array, smooth: bool, out: Array) -> None:
        if smooth or len(self.taps) == 1:
            out[:] = fine[self.half : self.half + len(out) * self.factor : self.factor]
        elif fine.any():
            out[:] = decimated(fine, self.taps, self.factor, len(out))


def _advanced(truths: Truths, stages: Sequence[_Stage], smooth: NDArray[np.bool_], count: int) -> Array:
    first, last = stages
    between = last.missing(count)
    moved = first.advance(truths.advance(first.missing(between)), between, smooth)
    return last.advance(moved, count, smooth)
