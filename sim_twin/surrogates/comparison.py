"""Networks and simple ways side by side: four ways to hold samples back, judged on the same points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.multioutput import MultiOutputRegressor

from sim_twin.surrogates.judging import Score, mean_of, scores
from sim_twin.surrogates.samples import LEARNT, TESTED, Over, Samples, mean_cycle
from sim_twin.surrogates.surrogate import Features, learnt

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]
_HELD_BACK, _LATE = TESTED / (LEARNT + TESTED), 0.5
"""Shares of all points, wherever they lie, and of a run's revolutions."""
MOST = 20_000
"""Points that are learnt where all may be: 40 for each unit of the largest network."""
WINDOWS = 6
_FEWEST_TURNS = 3
_ERROR_GOAL = 0.01


def _middle(samples: Samples, *names: str) -> Rows:
    """Which samples have settings in the middle of at least three, by the sum of their ranks."""
    _, ranks = np.unique(sum(samples.classes(name) for name in names), return_inverse=True)
    ranks = ranks.ravel()
    return np.asarray(ranks == (ranks.max() + 1) // 2) if ranks.max() > 1 else np.zeros(len(samples), bool)


POINTS, CYCLES = "random points", "held-out cycles"
SPEED, CLEARANCE = "held-out speed", "held-out clearance"
SPLITS: Final[Mapping[str, Callable[[Samples], Rows]]] = {
    POINTS: lambda samples: np.zeros(len(samples), bool),
    CYCLES: lambda samples: samples.late_turns(_LATE),
    SPEED: lambda samples: _middle(samples, "speed"),
    CLEARANCE: lambda samples: _middle(samples, "clearance_1", "clearance_2"),
}
"""What is held back beside a random third of all points, by what that is called. The paper does the first."""
OTHER_SETTINGS: Final = (SPEED, CLEARANCE)

Predict = Callable[[Array], Array]
Method = Callable[[Samples, Over, int, bool], Predict]
"""Learns from samples over an input with a seed, to be asked for points between those it learnt or not."""


def _network(kind: Any, searched: float = np.inf, **given: Any) -> Method:
    """Its width is found by cross-validation where it learns so many samples at most, else it is 1."""

    def learn(samples: Samples, over: Over, seed: int, by_points: bool) -> Predict:
        width = None if len(samples) <= searched else 1.0
        return learnt(samples, "", _named(samples), over, kind, seed, width, by_points, **given).predict

    return learn


def _boosting(samples: Samples, over: Over, seed: int, _: bool) -> Predict:
    taken = Features.of_samples(samples, over)
    trees = MultiOutputRegressor(HistGradientBoostingRegressor(random_state=seed))
    trees.fit(taken.of(samples.inputs), samples.outputs)
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
    "RBF, error goal": _network("rbf", LEARNT, max_units=500, error_goal=_ERROR_GOAL),
    "GRNN, 10 units": _network("grnn", max_prototypes=10),
    "GRNN, 500 units": _network("grnn", max_prototypes=500),
    "mean revolution": _mean_revolution,
    "gradient boosting": _boosting,
}
"""Ten units as in the paper, or as many as it takes to an error of 1 % of the variance, 500 at most: with
these a search of the width takes minutes where there are more points than the paper's."""

NEAREST, ALL = f"{LEARNT} nearest", "all"
AMOUNTS: Final = (NEAREST, ALL)
"""Of points that may be learnt: as many as in the paper, or all."""


@dataclass(frozen=True, slots=True)
class Row:
    """How a method does on a split over an input, having learnt an amount; the mean over channels."""

    split: str
    learnt: str
    over: Over
    method: str
    score: Score


def judged_points(samples: Samples) -> tuple[Rows, NDArray[np.int64]]:
    """Samples of which none is ever learnt, and in which window each is judged, shapes (n,); -1 for in none.

    Windows are of the paper's number of points, spread over the second half of the runs in the middle of
    speeds and clearances: every split holds them back, so that every method on every split has the same
    points to predict and the same floor.
    """
    held_back = np.random.default_rng(0).random(len(samples)) < _HELD_BACK
    there = samples.late_turns(_LATE)
    for split in OTHER_SETTINGS:
        middle = SPLITS[split](samples)
        there &= middle | (not middle.any())
    windows, runs = np.full(len(samples), -1), np.unique(samples.runs[there])
    for run in runs:
        rows = np.flatnonzero(there & (samples.runs == run))
        count = max(1, min(WINDOWS // len(runs), len(rows) // (LEARNT + TESTED)))
        for start in np.linspace(0, max(0, len(rows) - LEARNT - TESTED), count).astype(int):
            windows[rows[start : start + LEARNT + TESTED]] = windows.max() + 1
    return held_back, np.where(held_back, windows, -1)


def compared(samples: Samples, split: str, amount: str, over: Over, seed: int = 0) -> list[Row]:
    """Each method on one split; none where the samples do not allow of it.

    Raises ValueError where there is too little to learn from.
    """
    aside = SPLITS[split](samples)
    held_back, windows = judged_points(samples)
    asked = windows >= 0
    if (split != POINTS and not aside.any()) or not asked.any():
        return []
    may, judged = samples[~held_back & ~aside], samples[asked]
    if amount == ALL:
        tasks = [(may.thinned(MOST, np.random.default_rng(seed)), np.arange(len(judged)))]
    else:
        each = [np.flatnonzero(windows[asked] == window) for window in np.unique(windows[asked])]
        tasks = [(_nearest(may, judged[here], samples), here) for here in each]
    rows, whole = [], samples[np.isin(samples.runs, judged.runs)]
    for name, method in METHODS.items():
        predicted = np.empty_like(judged.outputs)
        for known, here in tasks:
            by_points = split == POINTS or len(np.unique(known.turns)) < _FEWEST_TURNS
            predicted[here] = method(known, over, seed, by_points)(judged.inputs[here])
        rows.append(Row(split, amount, over, name, mean_of(scores(judged, predicted, whole))))
    return rows


def _nearest(may: Samples, asked: Samples, samples: Samples) -> Samples:
    """The paper's number of points, by settings nearest to those that are asked for, then by time."""
    unit = np.where(np.ptp(samples.settings, axis=0) > 0, np.ptp(samples.settings, axis=0), 1.0)
    settings = np.linalg.norm((may.settings - asked.settings[0]) / unit, axis=1).round(1)
    times = np.abs(may.column("time") - np.median(asked.column("time")))
    return may[np.sort(np.lexsort([times, settings])[:LEARNT])]


def _named(samples: Samples) -> tuple[str, ...]:
    return tuple(f"output {number}" for number in range(1, samples.outputs.shape[1] + 1))


OVERS: Final[Sequence[Over]] = ("angle", "time")
