"""Samples of runs as a surrogate learns from them: crank angle, settings of the rig, what it showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, Self

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
LEARNT, TESTED = 500, 259
"""Points of the paper."""
_BINS = 720
"""Of a mean cycle: half a degree each."""
_HELD, _EDGE = 2e-3, 1e-6
"""Of its value: what a drive's mean speed may be off from run to run, and what an input is by rounding."""


def slack(name: str, value: Array | float) -> Any:
    """By how much an input of such a value may differ and count as the same, in the shape of `value`."""
    return (_HELD if name == "speed" else _EDGE) * np.abs(value)


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

    def classes(self, name: str) -> NDArray[np.int64]:
        """A number for each sample, shape (n,), by a setting, from its least up; alike ones have the same."""
        each, which = np.unique(self.column(name), return_inverse=True)
        apart = np.diff(each) > slack(name, each[1:])
        return np.concatenate([[0], np.cumsum(apart)])[which.ravel()]

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
    learnt, asked = _bins(samples.column("angle")), _bins(angles)
    seen = np.bincount(learnt, minlength=_BINS)
    there = np.flatnonzero(seen)
    means = []
    for column in samples.outputs.T:
        total = np.bincount(learnt, column, _BINS)
        means.append(np.interp(np.arange(_BINS), there, total[there] / seen[there], period=_BINS)[asked])
    return np.array(means).T


def about_the_mean_cycle(samples: Samples, judged: Samples) -> Array:
    """Mean square that the mean revolution of one run leaves at `judged` of it, shape (channels,).

    It is that of a mean revolution that were known without error: each value is held against the mean of the
    other revolutions there, m - 1 of them, which adds a share of 1 / (m - 1). About the mean value where no
    angle was passed twice.
    """
    first = samples.turns.min()
    cells = (samples.turns - first) * _BINS + _bins(samples.column("angle"))
    shape = int(np.ptp(samples.turns)) + 1, _BINS
    seen = np.bincount(cells, minlength=shape[0] * _BINS)
    turns = np.count_nonzero(seen.reshape(shape), axis=0)
    here = (judged.turns - first) * _BINS + _bins(judged.column("angle"))
    known = (turns[here % _BINS] > 1) & (seen[here] > 0)
    if not known.any():
        return np.asarray(judged.outputs.var(axis=0))
    others = turns[here[known] % _BINS] - 1
    found = []
    for all_shown, shown in zip(samples.outputs.T, judged.outputs.T, strict=True):
        means = np.bincount(cells, all_shown, len(seen)) / np.maximum(seen, 1)  # of each revolution
        at_an_angle = means.reshape(shape).sum(axis=0)[here[known] % _BINS]
        left = shown[known] - (at_an_angle - means[here[known]]) / others
        found.append(np.mean(left**2 * others / (others + 1)))
    return np.array(found)


def _bins(angles: Array) -> NDArray[np.int64]:
    return np.asarray(np.int64(angles / (2 * np.pi) % 1.0 * _BINS) % _BINS)
