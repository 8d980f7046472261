"""True signals of several runs on their samples' grid, anti-aliased, before the rest of their chains."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from sim_twin.decimation import Decimation
from sim_twin.ensembles.simulate import Variant
from sim_twin.rigs.rig_model import Truths
from sim_twin.sensors import Encoder, anti_alias_taps
from sim_twin.status import Status
from sim_twin.stream import Truth

Array = NDArray[np.float64]
_CHUNK = 512
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
    twin = variants[0].twin
    smooth = np.array(  # read as they are
        [
            name in twin.model.smooth(twin.rig) or isinstance(twin.sensors.get(name), Encoder)
            for name in twin.channels
        ]
    )
    plain, factor = np.tile(smooth, len(variants)), oversampling // _LAST_FACTOR
    first_taps, last_taps = _taps(factor), anti_alias_taps(_LAST_FACTOR, 0.0)
    coarse = Decimation(first_taps, factor, plain, held=len(first_taps) // 2)
    last = Decimation(last_taps, _LAST_FACTOR, plain, held=len(last_taps) // 2)
    before = round(settle * sample_rate)
    unseen = max(0, before - (len(first_taps) // factor + len(last_taps)) // _LAST_FACTOR)
    for first in range(0, unseen, _CHUNK):
        truths.advance(min(_CHUNK, unseen - first) * oversampling)
    rows = np.empty((len(plain), before - unseen + count))
    for first in range(0, rows.shape[1], _CHUNK):
        wanted = min(_CHUNK, rows.shape[1] - first)
        between = last.missing(wanted)
        fine = truths.advance(coarse.missing(between)).reshape(len(plain), -1)
        rows[:, first : first + wanted] = last.advance(coarse.advance(fine, between), wanted)
    finished = (status is Status.COMPLETED for status in truths.statuses)
    seen = rows[:, before - unseen :].reshape(len(variants), len(smooth), count)
    return [one if ended else None for one, ended in zip(seen, finished, strict=True)]


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
    """A first stage's taps at its input rate: all that would fall onto the last stage's pass band is gone.

    Kaiser window (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.5), as scipy.signal has it, which
    each worker would load for a second for these taps alone.
    """
    if factor == 1:
        return np.ones(1)
    width = 2 * (1 / factor - 2 * _PASS / _LAST_FACTOR / factor)
    count = ceil((_ATTENUATION_DB - 7.95) / 2.285 / (pi * width) + 1) | 1
    k, window = np.arange(count) - count // 2, np.kaiser(count, 0.1102 * (_ATTENUATION_DB - 8.7))
    taps = np.sinc(k / factor) * window
    return np.asarray(taps / taps.sum())
