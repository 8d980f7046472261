"""Samples of runs as a surrogate learns from them: crank angle, settings of the rig, what it showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Over = Literal["angle", "time"]

COLUMNS: Final = {
    "time": "s",
    "angle": "rad",
    "speed": "rpm",
    "clearance_1": "mm",
    "clearance_2": "mm",
    "density": "kg/m3",
}
"""Inputs and their units. The `density` is the material's: what of it acts is the links' inertia."""
SETTINGS: Final = tuple(name for name in COLUMNS if name not in ("time", "angle"))
_BINS = 720
"""Of a mean cycle: half a degree each."""


@dataclass(frozen=True, slots=True)
class Samples:
    """`inputs` as `COLUMNS` has them, shape (n, 6); `outputs` of shape (n, channels).

    `runs` numbers the run of each sample, `turns` its revolution within it; both of shape (n,).
    """

    inputs: Array
    outputs: Array
    runs: NDArray[np.int64]
    turns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.inputs)

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Samples:
        return Samples(self.inputs[rows], self.outputs[rows], self.runs[rows], self.turns[rows])

    @classmethod
    def joined(cls, parts: Sequence[Samples]) -> Self:
        """Of several runs, numbered anew."""
        return cls(
            np.concatenate([each.inputs for each in parts]),
            np.concatenate([each.outputs for each in parts]),
            np.concatenate([np.full(len(each), number) for number, each in enumerate(parts)]),
            np.concatenate([each.turns for each in parts]),
        )

    def column(self, name: str) -> Array:
        return self.inputs[:, list(COLUMNS).index(name)]

    @property
    def settings(self) -> Array:
        """How the rig was set, shape (n, settings)."""
        return self.inputs[:, [list(COLUMNS).index(name) for name in SETTINGS]]

    def thinned(self, most: int, random: np.random.Generator) -> Samples:
        """So many of them at most, drawn without order kept."""
        return self if len(self) <= most else self[np.sort(random.permutation(len(self))[:most])]

    def late_turns(self, share: float) -> NDArray[np.bool_]:
        """Which samples lie in the last `share` of their run's revolutions, shape (n,)."""
        late = np.zeros(len(self), bool)
        for run in np.unique(self.runs):
            here = self.runs == run
            first, last = self.turns[here].min(), self.turns[here].max() + 1
            late |= here & (self.turns >= last - share * (last - first))
        return late


def mean_cycle(samples: Samples, angles: Array) -> Array:
    """What `samples` show on average at each of `angles` (rad), shape (n, channels)."""
    learnt, asked = (
        np.int64(each / (2 * np.pi) % 1.0 * _BINS) % _BINS for each in (samples.column("angle"), angles)
    )
    seen = np.bincount(learnt, minlength=_BINS)
    there = np.flatnonzero(seen)
    means = []
    for column in samples.outputs.T:
        total = np.bincount(learnt, column, _BINS)
        means.append(np.interp(np.arange(_BINS), there, total[there] / seen[there], period=_BINS)[asked])
    return np.array(means).T
