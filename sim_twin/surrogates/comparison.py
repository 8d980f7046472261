"""Both networks and two simple ways side by side, on four ways to hold samples back from learning."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.multioutput import MultiOutputRegressor

from sim_twin.surrogates.judging import Score, mean_of, scores
from sim_twin.surrogates.samples import Over, Samples, mean_cycle
from sim_twin.surrogates.surrogate import Features, learnt

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]
_HELD_BACK = 259 / 759
"""The paper's share."""
_LEARNT_FROM, _JUDGED_ON = 15_000, 40_000


_DENSE_S = 0.3
"""About a revolution: as many points as are learnt then lie close to each other."""


def _points(samples: Samples, random: np.random.Generator) -> Rows:
    return np.asarray(random.random(len(samples)) < _HELD_BACK)


def _turns(samples: Samples, _: np.random.Generator) -> Rows:
    return samples.late_turns(_HELD_BACK)


def _speed(samples: Samples, _: np.random.Generator) -> Rows:
    """The speed in the middle."""
    return _middle(samples.column("speed"))


def _clearances(samples: Samples, _: np.random.Generator) -> Rows:
    """The pair of clearances in the middle, by their sum."""
    return _middle(samples.column("clearance_1") + samples.column("clearance_2"))


def _middle(values: Array) -> Rows:
    each = np.unique(values)
    return np.asarray(values == each[len(each) // 2]) if len(each) > 2 else np.zeros(len(values), bool)


POINTS, DENSE = "random points", "random points, first 0.3 s"
SPLITS: Final[Mapping[str, Callable[[Samples, np.random.Generator], Rows]]] = {
    DENSE: _points,
    POINTS: _points,
    "held-out cycles": _turns,
    "held-out speed": _speed,
    "held-out clearance": _clearances,
}
"""Which samples are held back, by what that is called. The paper does one of the first two."""
OTHER_SETTINGS: Final = ("held-out speed", "held-out clearance")

Predict = Callable[[Array], Array]
Method = Callable[[Samples, Over, int, bool], Predict]
"""Learns from samples over an input with a seed, to be asked for points between those it learnt or not."""


def _network(kind: Any, **given: Any) -> Method:
    def learn(samples: Samples, over: Over, seed: int, by_points: bool) -> Predict:
        few = samples.thinned(_LEARNT_FROM, np.random.default_rng(seed))
        return learnt(few, "", _named(few), over, kind, seed, by_points=by_points, **given).predict

    return learn


def _boosting(samples: Samples, over: Over, seed: int, _: bool) -> Predict:
    few = samples.thinned(_LEARNT_FROM, np.random.default_rng(seed))
    taken = Features.of_samples(few, over)
    trees = MultiOutputRegressor(HistGradientBoostingRegressor(random_state=seed))
    trees.fit(taken.of(few.inputs), few.outputs)
    return lambda inputs: np.asarray(trees.predict(taken.of(inputs)))


def _mean_revolution(samples: Samples, _: Over, __: int, ___: bool) -> Predict:
    """The mean revolution of the learnt run whose settings are nearest."""
    starts = {run: np.flatnonzero(samples.runs == run) for run in np.unique(samples.runs)}
    settings = np.array([samples.settings[rows[0]] for rows in starts.values()])
    unit = np.where(np.ptp(settings, axis=0) > 0, np.ptp(settings, axis=0), 1.0)

    def predict(inputs: Array) -> Array:
        asked = Samples(inputs, np.empty((len(inputs), 0)), np.zeros(0, np.int64), np.zeros(0, np.int64))
        found = np.empty((len(inputs), samples.outputs.shape[1]))
        each, which = np.unique(asked.settings, axis=0, return_inverse=True)
        for number, wanted in enumerate(each):
            nearest = int(np.argmin(np.sum(((settings - wanted) / unit) ** 2, axis=1)))
            rows = list(starts.values())[nearest]
            here = which.ravel() == number
            found[here] = mean_cycle(samples[rows], asked.column("angle")[here])
        return found

    return predict


METHODS: Final[Mapping[str, Method]] = {
    "RBF, 10 units": _network("rbf", max_units=10),
    "RBF, 100 units": _network("rbf", max_units=100),
    "GRNN": _network("grnn", max_prototypes=_LEARNT_FROM),
    "mean revolution": _mean_revolution,
    "gradient boosting": _boosting,
}


@dataclass(frozen=True, slots=True)
class Row:
    """How a method does on a split over an input; the mean over channels."""

    split: str
    over: Over
    method: str
    score: Score


def compared(samples: Samples, split: str, over: Over, seed: int = 0) -> list[Row]:
    """Each method on one split; none where the samples do not allow of it."""
    if split == DENSE:
        samples = samples[samples.column("time") < _DENSE_S]
    held_back = SPLITS[split](samples, np.random.default_rng(seed))
    if not held_back.any() or held_back.all():
        return []
    learn, judge = samples[~held_back], samples[held_back]
    few, rows = judge.thinned(_JUDGED_ON, np.random.default_rng(seed)), []
    for name, method in METHODS.items():
        predicted = method(learn, over, seed, split in (POINTS, DENSE))(few.inputs)
        rows.append(Row(split, over, name, mean_of(scores(few, predicted, judge))))
    return rows


def _named(samples: Samples) -> tuple[str, ...]:
    return tuple(f"output {number}" for number in range(1, samples.outputs.shape[1] + 1))


OVERS: Final[Sequence[Over]] = ("angle", "time")
