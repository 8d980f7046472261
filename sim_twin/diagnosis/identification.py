"""Fits values of a rig that may lie far from what its scenario says to recordings of it, healthy as it is.

Rigs are simulated with values from the prior, then from ever nearer about what explains the recordings. In
each round the values are regressed on fingerprints, as a calibration does with tolerances, and how that
summary follows the values is fitted where they are likely by now: a chain of linear and normal steps, each
held against the same wide prior (regression: Fearnhead and Prangle 2012, as in `matching`; proposals that
narrow: Beaumont, Cornuet, Marin and Robert 2009, doi:10.1093/biomet/asp052).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, log

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, ndtr, ndtri

from daq.errors import SimulationFailed
from sim_twin.diagnosis.matching import Summary, followed
from sim_twin.diagnosis.posterior import Estimate
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.subject import Draw, Execute, Subject

Array = NDArray[np.float64]
VALUES = "model"
"""The one effect of a draw: its parameters are the values."""
BLOCKS = 2
"""That each run of a rig is simulated for, by which its own scatter is told."""
_FARTHEST = 5.0
"""Deviations of the prior."""
_WIDER, _NARROWS_FAST = 1.5, 0.4
"""Proposals over what rigs of a few blocks would leave open about the posterior so far, which may be off.

Not so after a round that left less than so much of any deviation: nearer by, less of it bends.
"""
_WIDEST, _LEAST = 1.25, 1e-12
"""Deviations of the prior, than which a proposal is no wider in any direction; square of the narrowest."""
_NEAR = 0.995
"""Share of a proposal within which earlier rigs are looked at again."""
_EACH, _MORE = 10, 80
"""Rigs of a round: so many for each value, and so many more where they can be afforded."""
_ONE_MORE = 120
"""Rigs by which one more run is judged."""
_FEWEST = 8
"""Rigs for each value, from which on anything is made of them."""
FEWEST_ROUNDS, MOST_ROUNDS = 3, 7
_MOVED, _ONE_MOVED, _NARROWED = 0.25, 0.6, 0.8
"""Deviations of all that is told together and of any one value, which of many chance moves by more; and to
what share of it a deviation shrinks: what stays within them has come to rest."""
_TOLD = 0.5
"""Of its deviation before, which one that is told has at most."""
_AT_END = 3.5
"""Deviations before, from which on a value lies at the end of where it was looked for: 1 rig in 2000 does."""
_TOGETHER = 0.9
"""Correlation of a value with what others say of it, from which on it is told together with them only."""
_HAS_A_PART = 0.3
"""Of a value's deviation: another that moves it by more has a part in that."""
_AS_OPEN = 0.9
"""Of its deviation before: chance alone mostly narrows what nothing tells by less."""
_OF_95 = 1.96


@dataclass(frozen=True, slots=True)
class Wide:
    """A value that is looked for, by `name`: before, normal with `deviation` about `centre`, low to high.

    `by_ratio`: its logarithm is, and `deviation` one of ratios. `z`, its place, is standard normal before.
    """

    name: str
    centre: float
    deviation: float
    low: float = -inf
    high: float = inf
    by_ratio: bool = True

    def value(self, z: Array) -> Array:
        """Values at places, the same shape."""
        centre, first, last = self._normal
        inside = first + (last - first) * ndtr(np.clip(z, -_FARTHEST, _FARTHEST))
        found = centre + self.deviation * ndtri(inside)
        return np.asarray(np.clip(np.exp(found) if self.by_ratio else found, self.low, self.high))

    @property
    def _normal(self) -> tuple[float, float, float]:
        """Centre of what is normal, and the shares of it that lie below `low` and `high`."""

        def taken(value: float) -> float:
            return value if not self.by_ratio else log(value) if value > 0 else -inf

        centre = taken(self.centre)
        first, last = (float(ndtr((taken(end) - centre) / self.deviation)) for end in (self.low, self.high))
        return centre, first, last


@dataclass(frozen=True, slots=True)
class Known:
    """Where the values lie: normal in their places, `mean` (n,) and `covariance` (n, n)."""

    wides: tuple[Wide, ...]
    mean: Array
    covariance: Array

    @property
    def deviation(self) -> Array:
        return np.sqrt(np.diag(self.covariance))

    def told(self) -> tuple[bool, ...]:
        """Of each value, whether the runs tell it: not where it may lie beyond where it was looked for."""
        return tuple(bool(each) for each in (self.deviation <= _TOLD) & (np.abs(self.mean) < _AT_END))

    def open(self) -> tuple[bool, ...]:
        """Of each value, whether the runs tell too little of it, wherever it is looked for."""
        return tuple(bool(each) for each in self.deviation > _TOLD)

    def at_ends(self) -> list[str]:
        """Names of values that lie at the end of where they were looked for, and would be told otherwise."""
        beyond = (self.deviation <= _TOLD) & (np.abs(self.mean) >= _AT_END)
        return [wide.name for wide, each in zip(self.wides, beyond, strict=True) if each]

    def widened(self, times: Array | float) -> Known:
        """The same, of each value so many times as wide (n,), where a model leaves something open."""
        times = np.broadcast_to(times, self.mean.shape)
        return Known(self.wides, self.mean, self.covariance * np.outer(times, times))

    def as_open_as_before(self) -> bool:
        """Whether the runs tell nothing: neither a value nor any combination of several."""
        return bool(np.linalg.eigvalsh(self.covariance)[0] > _AS_OPEN**2)

    def estimates(self) -> tuple[Estimate, ...]:
        """Medians and 95 % intervals."""
        ends = (self.mean + side * _OF_95 * self.deviation for side in (0.0, -1.0, 1.0))
        middle, low, high = (self.values(end) for end in ends)
        return tuple(Estimate(*map(float, each)) for each in zip(middle, low, high, strict=True))

    def values(self, places: Array) -> Array:
        """Values at places (..., n)."""
        columns = [wide.value(places[..., k]) for k, wide in enumerate(self.wides)]
        return np.stack(columns, axis=-1)

    def together(self) -> list[tuple[str, ...]]:
        """Values that are not told each by itself, but together: one of them once the others are known.

        No set holds another.
        """
        precision = np.linalg.inv(self.covariance)
        left = 1 / np.sqrt(np.diag(precision))  # deviation of each once the others are known
        # what a deviation of each of the others moves a value by, in deviations of it
        moves = np.abs(precision) * left[:, None] ** 2 * self.deviation / self.deviation[:, None]
        np.fill_diagonal(moves, 0.0)
        hangs = (~np.array(self.told())) & (left < np.sqrt(1 - _TOGETHER**2) * self.deviation)
        sets = set[frozenset[int]]()
        for one in np.flatnonzero(hangs):
            others = np.flatnonzero(moves[one] > min(_HAS_A_PART, moves[one].max() / 2))
            sets.add(frozenset([int(one), *map(int, others)]))
        whole = sorted(sorted(each) for each in sets if not any(other < each for other in sets))
        return [tuple(self.wides[one].name for one in each) for each in whole]


@dataclass(frozen=True, slots=True)
class Round:
    """What is known after a round of so many rigs, and how far that moved, in deviations.

    `unrest` (n,) is what it moved beyond what it narrowed: what lay within wide deviations before may move by
    many of the narrow ones. Not `last`: another round follows.

    `apart` (runs,): how far what a run says of the values lies from what the others say, over that of the
    simulated rig whose runs lie farthest apart. Empty of one run and, before the last round, where a run says
    what none of the simulated rigs does: how it follows the values is not known so far out.
    """

    rigs: int
    known: Known
    moved: Array
    unrest: Array
    converged: bool
    last: bool
    apart: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Rounds:
    """How much is simulated: so many `rigs` in each of at most so many rounds."""

    rigs: int
    most: int


def rounds_of(values: int, affordable: float = inf) -> Rounds:
    """Those that look for so many values by about as many rigs as can be afforded; never fewer than tell."""
    least = _EACH * values
    most = int(np.clip(affordable / least, FEWEST_ROUNDS, MOST_ROUNDS))
    return Rounds(int(np.clip(affordable / most, least, least + _MORE)), most)


def nothing_known(wides: Sequence[Wide]) -> Known:
    """What is known of the values before any run."""
    return Known(tuple(wides), np.zeros(len(wides)), np.eye(len(wides)))


def fitted_rounds(
    subject: Subject,
    wides: Sequence[Wide],
    measured: NDArray[np.float32],
    simulate: Execute,
    rng: np.random.Generator,
    told: Sequence[float] = (),
    planned: Rounds | None = None,
) -> Iterator[Round]:
    """Round by round what `measured` fingerprints (blocks, numbers) say of the values.

    `told`: how many blocks of each run they are worth; empty: as many as there are. Nothing `planned`: as
    many rigs as pay.

    `subject` takes a draw's values as its one effect, `VALUES`. Ends where nothing moves any more, or after
    the last round; () from `simulate` (no more time) ends it as well. Raises SimulationFailed where too few
    rigs came out.
    """
    moments, planned = Moments(subject.layout), planned or rounds_of(len(wides))
    about = known = nothing_known(wides)
    library, worth, wider = _Library(moments), moments.worth(told, len(measured)), 1.0
    for number in range(1, planned.most + 1):
        places = _proposed(about, wider, planned.rigs, rng)
        observed = simulate(draws_of(known, places, rng))
        library.add(places, [each[0] if each else None for each in observed])
        cut_short = any(not each for each in observed)
        near = library.near(about, wider, planned.rigs)
        # nearer by than rigs of few blocks are told apart, a fit is of their scatter
        found, about = _posteriors(about, near, moments, measured, rng, (worth, np.minimum(worth, BLOCKS)))
        deviation = np.maximum(found.deviation, 1e-9)
        moved = np.abs(found.mean - known.mean) / deviation
        may_move = np.maximum((known.deviation / deviation) ** 2 - 1, 0)
        narrowed = float(np.min(found.deviation / known.deviation))
        wider = 1.0 if narrowed < _NARROWS_FAST else _WIDER
        at_rest = moved.max() < _ONE_MOVED and narrowed > _NARROWED
        converged = number >= FEWEST_ROUNDS and at_rest and _moved_together(known, found) < _MOVED
        last = converged or cut_short or number == planned.most
        apart = _apart(near, moments, measured, rng, told, anywhere=last)
        known, unrest = found, np.sqrt(np.maximum(moved**2 - may_move, 0))
        yield Round(len(library), known, moved, unrest, converged, last, apart)
        if last:
            return


def _moved_together(before: Known, now: Known) -> float:
    """Root mean square, in deviations, over as many directions as are told."""
    off = now.mean - before.mean
    told = max(float(np.sum(1 - np.minimum(np.linalg.eigvalsh(now.covariance), 1.0))), 1.0)
    return float(np.sqrt(off @ np.linalg.solve(now.covariance, off) / told))


def draws_of(known: Known, places: Array, rng: np.random.Generator, blocks: int = BLOCKS) -> list[Draw]:
    """Rigs with the values at `places` (rigs, n), otherwise healthy."""
    names = [wide.name for wide in known.wides]
    return [
        Draw(
            ((VALUES, dict(zip(names, map(float, row), strict=True))),),
            int(rng.integers(2**62)),
            blocks=blocks,
        )
        for row in known.values(places)
    ]


def _proposed(known: Known, wider: float, rigs: int, rng: np.random.Generator) -> Array:
    normals = rng.standard_normal((rigs, len(known.wides)))
    return np.asarray(np.clip(known.mean + normals @ _root(known, wider).T, -_FARTHEST, _FARTHEST))


def _root(known: Known, wider: float) -> Array:
    """Of the covariance of a proposal, (n, n)."""
    squares, directions = np.linalg.eigh(known.covariance)
    return np.asarray(directions * np.minimum(wider * np.sqrt(np.maximum(squares, _LEAST)), _WIDEST))


@dataclass(frozen=True, slots=True)
class _Near:
    """Rigs near what is known: `local` places (rigs, n), `root` (n, n) @ them from its mean, and features."""

    root: Array
    local: Array
    features: Array


class _Library:
    """Rigs so far: places (n,) of their values, features (blocks, features)."""

    def __init__(self, moments: Moments) -> None:
        self._moments = moments
        self.places: list[Array] = []
        self.features: list[Array] = []

    def __len__(self) -> int:
        return len(self.places)

    def add(self, places: Array, shown: Sequence[NDArray[np.float32] | None]) -> None:
        for place, blocks in zip(places, shown, strict=True):
            if blocks is not None:
                self.places.append(place)
                self.features.append(self._moments(blocks))

    def near(self, about: Known, wider: float, rigs: int) -> _Near:
        """Those that a proposal of `rigs` about what is known may make; SimulationFailed where few are."""
        count = len(about.wides)
        places, root = np.array(self.places).reshape(-1, count), _root(about, wider)
        local = np.linalg.solve(root, (places - about.mean).T).T
        near = np.sum(local**2, axis=1) <= chdtri(count, 1.0 - _NEAR)
        if near.sum() < _FEWEST * count:
            raise SimulationFailed(
                f"only {near.sum()} of {rigs} rigs could be simulated",
                "are the ranges of the values such as a rig can have?",
            )
        return _Near(root, local[near], np.array(self.features)[near])


def _posteriors(
    about: Known,
    near: _Near,
    moments: Moments,
    measured: NDArray[np.float32],
    rng: np.random.Generator,
    worths: Sequence[Array],
) -> list[Known]:
    """What the rigs near `about` make of the measurement, for the prior of all values.

    One for each of `worths`: how many blocks each feature is worth (features,).
    """
    following, root = followed(near.local, near.features, moments, rng), near.root
    summary = following.summary(moments(measured))
    found = []
    for worth in worths:
        response = following.response(worth)
        # the prior, standard normal in the places, in the local coordinates
        pull = response.slope.T @ response.precision
        covariance = np.linalg.inv(pull @ response.slope + root.T @ root)
        mean = covariance @ (pull @ (summary - response.centre) - root.T @ about.mean)
        spread = root @ covariance @ root.T
        centre = np.clip(about.mean + root @ mean, -_FARTHEST, _FARTHEST)
        found.append(Known(about.wides, centre, np.asarray((spread + spread.T) / 2)))
    return found


def _apart(
    near: _Near,
    moments: Moments,
    measured: NDArray[np.float32],
    rng: np.random.Generator,
    told: Sequence[float],
    anywhere: bool,
) -> tuple[float, ...]:
    """Of each run, see `Round`; in the local coordinates, in which rigs are standard normal.

    Not `anywhere`: empty unless each run by itself is such as those of the rigs.
    """
    runs = np.unique(moments.runs)
    if len(runs) < 2:
        return ()
    seen, worth = moments(measured), moments.worth(told, len(measured))
    simulated, recorded = list[Summary](), list[Summary]()
    for run in runs:
        own = moments.runs == run
        following = followed(near.local, near.features[..., own], moments.of_run(run), rng)
        healthy, response = (
            following.response(each) for each in (np.full(own.sum(), float(BLOCKS)), worth[own])
        )
        place = following.summary(seen[..., own])[None] - response.centre
        if not anywhere and response.misfit(place)[0] > healthy.misfit(healthy.of_rigs).max():
            return ()
        simulated.append(healthy.summary(healthy.of_rigs))
        recorded.append(response.summary(place))
    usual = _from_the_others(simulated).max(axis=2)
    farthest = np.max(_from_the_others(recorded)[..., 0] / usual, axis=0)
    return tuple(map(float, farthest))


def _from_the_others(runs: Sequence[Summary]) -> Array:
    """How far what each of some runs says lies from what the others say, of many rigs: (2, runs, rigs).

    In all that it tells together, and in whichever it tells most differently.
    """
    together, alone, count = [], [], runs[0].slope.shape[1]
    for own in runs:
        others = [each for each in runs if each is not own]
        left = np.linalg.inv(np.eye(count) + sum(each.information for each in others))
        expected = sum(each.pull for each in others) @ left @ own.slope.T
        off = own.place - expected
        spread = own.scatter + own.slope @ left @ own.slope.T
        together.append(np.sqrt(np.mean(off * np.linalg.solve(spread, off.T).T, axis=1)))
        alone.append(np.max(np.abs(off) / np.sqrt(np.diag(spread)), axis=1))
    return np.array([together, alone])


def after_one_more(subject: Subject, known: Known, simulate: Execute, rng: np.random.Generator) -> Array:
    """Deviations (n,) that the values are expected to have after one more run, which `subject` simulates.

    Raises SimulationFailed where too few rigs came out.
    """
    root = np.linalg.cholesky(known.covariance)
    local = rng.standard_normal((_ONE_MORE, len(root)))
    places = np.clip(known.mean + local @ root.T, -_FARTHEST, _FARTHEST)
    library = _Library(Moments(subject.layout))
    library.add(local, [each[0] if each else None for each in simulate(draws_of(known, places, rng))])
    if len(library) < _ONE_MORE / 2:
        raise SimulationFailed("hardly any rig could be simulated at that setting", "try another")
    moments = Moments(subject.layout)
    following = followed(np.array(library.places), np.array(library.features), moments, rng)
    response = following.response(moments.worth((), BLOCKS))
    covariance = np.linalg.inv(response.slope.T @ response.precision @ response.slope + np.eye(len(root)))
    return np.asarray(np.sqrt(np.diag(root @ covariance @ root.T)))
