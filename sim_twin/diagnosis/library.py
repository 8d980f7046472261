"""What has been simulated so far, and what is learned from it: directions, scatters, emulators."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution, coordinates_of
from sim_twin.diagnosis.cause import Hypothesis, named, parts_of
from sim_twin.diagnosis.emulator import Emulator, fitted
from sim_twin.diagnosis.space import Moments, space_of
from sim_twin.diagnosis.subject import Draw, Named, Observed

Array = NDArray[np.float64]
_FEWEST_SHARED = 4
"""Motions over which those cases are spread that may share some."""
TOGETHER = 18
"""Cases that may share a motion: what one changed channel shows costs little beside it."""
_DIRECTIONS = 80
_SHARE = 6
"""Healthy and left-out fingerprints for each direction, at least."""
FEWEST = 6
"""Observations of a hypothesis from which its responses can be emulated."""
_SHRINK = 0.05
_FARTHEST = 8.0
_LEAST_SCATTER = 0.1


@dataclass(frozen=True, slots=True)
class Order:
    """Draws to be simulated, and what each observation of each of them is a case of."""

    draws: tuple[Draw, ...] = ()
    cases: tuple[tuple[tuple[Hypothesis, Array], ...], ...] = ()

    def __add__(self, other: Order) -> Order:
        return Order(self.draws + other.draws, self.cases + other.cases)

    def __len__(self) -> int:
        return len(self.draws)


@dataclass(slots=True)
class Library:
    """Simulated fingerprints by hypothesis: parameters (n, ...) and fingerprints (n, blocks, numbers)."""

    _values: dict[Hypothesis, list[Array]] = field(default_factory=dict)
    _fingerprints: dict[Hypothesis, list[NDArray[np.float32]]] = field(default_factory=dict)
    failed: int = 0
    observations: int = 0

    def add(self, order: Order, observed: Sequence[Observed]) -> None:
        """Take what came of an order; what failed is counted."""
        for cases, shown in zip(order.cases, observed, strict=True):
            for (hypothesis, values), blocks in zip(cases, shown, strict=bool(shown)):
                if blocks is None:
                    self.failed += 1
                    continue
                self.observations += 1
                self._values.setdefault(hypothesis, []).append(values)
                self._fingerprints.setdefault(hypothesis, []).append(blocks)

    def of(self, hypotheses: Iterable[Hypothesis], numbers: NDArray[np.intp]) -> Library:
        """Only these hypotheses, only these numbers of their fingerprints."""
        kept = [h for h in hypotheses if h in self._values]
        fingerprints = {h: [each[:, numbers] for each in self._fingerprints[h]] for h in kept}
        return Library({h: self._values[h] for h in kept}, fingerprints)

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """All that something has been simulated of."""
        return tuple(self._values)

    def count(self, hypothesis: Hypothesis) -> int:
        return len(self._values.get(hypothesis, ()))

    def values(self, hypothesis: Hypothesis) -> Array:
        """Parameters of each observation, shape (n, parameters)."""
        return np.array(self._values[hypothesis])

    def fingerprints(self, hypothesis: Hypothesis) -> Sequence[NDArray[np.float32]]:
        """Fingerprints of each observation, (blocks, numbers)."""
        return self._fingerprints[hypothesis]


def order_of(
    cases: Mapping[Hypothesis, Array], rng: np.random.Generator, blocks: int = 1, together: int = TOGETHER
) -> Order:
    """Order one observation for each row of parameters of each hypothesis.

    Those in which only sensors differ from a healthy rig share motions, at most `together` of them one,
    spread over four at least.
    """
    draws: list[Draw] = []
    drawn: list[tuple[tuple[Hypothesis, Array], ...]] = []

    def simulate(effects: tuple[Named, ...], sensing: tuple[tuple[Named, ...], ...]) -> None:
        draws.append(Draw(effects, int(rng.integers(2**62)), sensing, blocks))

    of_sensors = [
        (hypothesis, row)
        for hypothesis, rows in cases.items()
        for row in rows
        if hypothesis and all(cause.sensing for cause in hypothesis)
    ]
    of_sensors = [of_sensors[k] for k in rng.permutation(len(of_sensors))]
    for hypothesis, rows in cases.items():
        if hypothesis and all(cause.sensing for cause in hypothesis):
            continue
        for row in rows:
            parts = zip(hypothesis, parts_of(hypothesis), strict=True)
            split = [(cause.sensing, cause.named(row[at])) for cause, at in parts]
            moving = tuple(effect for sensing, effect in split if not sensing)
            simulate(moving, (tuple(effect for sensing, effect in split if sensing),))
            drawn.append(((hypothesis, row),))
    # one that fails must not take most of them along
    together = max(1, min(together, len(of_sensors) // _FEWEST_SHARED))
    for first in range(0, len(of_sensors), together):
        shared = of_sensors[first : first + together]
        simulate((), tuple(named(hypothesis, row) for hypothesis, row in shared))
        drawn.append(tuple(shared))
    return Order(tuple(draws), tuple(drawn))


def learned(library: Library, moments: Moments, told: Sequence[float]) -> Attribution:
    """Make the most of a library for a measurement of so many blocks of each run as are `told`."""
    healthy = [moments(each) for each in library.fingerprints(())]
    first = np.array([each[0] for each in healthy])
    known = {
        h: np.array([moments(each[0]) for each in library.fingerprints(h)])
        for h in library.hypotheses
        if h and library.count(h) >= FEWEST
    }
    others = np.concatenate([first[:0], *known.values()])
    directions = max(4, min(_DIRECTIONS, (len(first) + len(others)) // _SHARE))
    space = space_of(first, others, moments.tolerance, directions)

    tolerated = space.tolerated(moments)
    rough = _whitening(space(first) - space(first).mean(axis=0), tolerated)
    y = {h: space(features) @ rough for h, features in known.items()}
    centre = (space(np.concatenate(healthy)) @ rough).mean(axis=0)
    roughly = {h: _emulator(library, h, y[h] - centre) for h in known if len(h) == 1}
    left = [space(first) @ rough - centre, *(each.left_out for each in roughly.values())]
    residuals = np.clip(np.concatenate(left), -_FARTHEST, _FARTHEST)
    whitener = rough @ _whitening(residuals, rough.T @ tolerated @ rough)

    several = [space.scaled(each) for each in healthy if len(each) > 1]
    within = np.concatenate([x - x.mean(axis=0) for x in several] or [first[:0]])
    less = (1 - 1 / np.asarray(told))[moments.runs]
    averaged = np.sqrt(less) * within @ space.basis @ whitener
    freedom = sum(len(each) - 1 for each in several)
    scatter, turn = _scatter(averaged, freedom, float(less.max()))
    whitener = whitener @ turn
    centre = (space(np.concatenate(healthy)) @ whitener).mean(axis=0)
    places = {h: space(features) @ whitener - centre for h, features in known.items()}
    singles: dict[Hypothesis, Emulator] = {
        h: _emulator(library, h, places[h], each.lengths) for h, each in roughly.items()
    }
    alone = Attribution(moments, space, whitener, centre, scatter, singles)
    pairs = {
        h: _emulator(library, h, place - alone.response(h, library.values(h))[0])
        for h, place in places.items()
        if len(h) > 1 and all((cause,) in singles for cause in h)
    }
    return replace(alone, emulators={**singles, **pairs})


def _emulator(
    library: Library, hypothesis: Hypothesis, places: Array, lengths: Array | None = None
) -> Emulator:
    return fitted(coordinates_of(hypothesis, library.values(hypothesis)), places, lengths)


def _whitening(residuals: Array, tolerated: Array) -> Array:
    """A matrix that makes residuals (n, directions) independent and of variance 1, small variances lifted.

    What is `tolerated` between programs (a covariance) counts as scatter, too.
    """
    covariance = residuals.T @ residuals / len(residuals) + tolerated
    values, vectors = np.linalg.eigh(covariance)
    lifted = (1 - _SHRINK) * np.maximum(values, 0.0) + _SHRINK * np.median(values) + 1e-12
    return np.asarray(vectors / np.sqrt(lifted))


def _scatter(averaged: Array, freedom: int, most: float) -> tuple[Array, Array]:
    """Variances of means over blocks, and the turn to directions in which they are independent.

    What differs between the blocks of a rig is `averaged` (n, directions), at `most` so much of a variance of
    1; what differs between rigs is not.
    """
    values, vectors = np.linalg.eigh(averaged.T @ averaged / max(freedom, 1))
    return np.maximum(1 - np.clip(values, 0.0, most), _LEAST_SCATTER), vectors
