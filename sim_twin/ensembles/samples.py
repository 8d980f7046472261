"""Observes what the channels of every run show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.ensembles.lockstep import OneByOne, apart
from sim_twin.ensembles.variant import Outcome, Variant
from sim_twin.rigs.side_by_side import Truths
from sim_twin.sensors import oversampling
from sim_twin.status import Status
from sim_twin.stream import Truth, TwinStream

Array = NDArray[np.float32]
Reduce = Callable[[Array], Any]
_MOST_TOGETHER = 16
_MEMORY = 64 * 2**20
"""Bytes of samples that one piece of work may hold."""
_BLOCK_S = 0.04


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples of `channels` through their measuring chains, noise in: float32, shape (channels, n).

    n = `duration` times `sample_rate`, after `settle` s in motion from rest. `reduce` is called with them
    where the run is simulated, and what it returns is kept instead; else thousands of runs fill memory.
    """

    channels: tuple[str, ...]
    sample_rate: float
    settle: float
    duration: float
    reduce: Reduce | None = None

    @property
    def together(self) -> int:
        """As many runs as memory allows; all lanes of the twin's kernels, if possible."""
        one = 4 * len(self.channels) * round(self.duration * self.sample_rate)
        return max(1, min(_MOST_TOGETHER, _MEMORY // max(1, one)))

    def observe(self, variants: Sequence[Variant]) -> list[Outcome[Any]]:
        """Samples of some runs of one rig, or what `reduce` makes of them."""
        rate = self.sample_rate * oversampling(self.sample_rate)
        truths = apart(truths_of(variants, rate), len(variants))
        runs = [_Run(each, truth, self) for each, truth in zip(variants, truths, strict=True)]
        total = round(self.settle * self.sample_rate) + round(self.duration * self.sample_rate)
        block = max(1, round(_BLOCK_S * self.sample_rate))
        for first in range(0, total, block):
            for run in runs:
                run.advance(min(block, total - first))
        return [run.outcome(self.reduce) for run in runs]


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


class _Run:
    """Keeps the wanted samples of one run until it fails."""

    def __init__(self, variant: Variant, truth: Truth, wanted: Samples) -> None:
        rng = None if variant.noise is None else np.random.default_rng(variant.noise)
        self._truth = truth
        self._stream = TwinStream(variant.twin, truth, wanted.sample_rate, rng)
        self._rows = [variant.twin.channels.index(name) for name in wanted.channels]
        self._to_skip = round(wanted.settle * wanted.sample_rate)
        self._kept = np.zeros((len(self._rows), round(wanted.duration * wanted.sample_rate)), np.float32)
        self._filled = 0

    def advance(self, count: int) -> None:
        if self._truth.status is not Status.COMPLETED:
            return
        try:
            samples = self._stream.advance(count)[self._rows, min(count, self._to_skip) :]
        except SimulationFailed:
            return
        self._to_skip -= count - samples.shape[1]
        self._kept[:, self._filled : self._filled + samples.shape[1]] = samples
        self._filled += samples.shape[1]

    def outcome(self, reduce: Reduce | None) -> Outcome[Any]:
        status = self._truth.status
        if status is not Status.COMPLETED:
            return Outcome(status)
        return Outcome(status, self._kept if reduce is None else reduce(self._kept))
