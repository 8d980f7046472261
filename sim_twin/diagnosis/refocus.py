"""Rigs about the best explanation as the centre: from there nothing lies far, and all is nearly straight.

The search compares everything from the healthy twin, where far numbers count by their logarithm and the
emulator of a cause serves its whole range. Here rigs are drawn from what the search believes of one
explanation, and its parameters are regressed on their fingerprints (see `matching`), as history matching does
after each wave (Gardner, Rogers et al. 2019, doi:10.1088/1742-6596/1264/1/012052).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import coordinates_of
from sim_twin.diagnosis.cause import Hypothesis, allowed_by, places_of, values_of
from sim_twin.diagnosis.library import Library, order_of
from sim_twin.diagnosis.matching import Following, followed
from sim_twin.diagnosis.posterior import Posterior, integrate
from sim_twin.diagnosis.search import Ranked
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.subject import Execute

Array = NDArray[np.float64]
Blocks = NDArray[np.float32]
_BLOCKS = 2
_WIDER = (0.5, 0.25, 0.25)
"""Drawn from the posterior with its weights to that power, round by round: about twice as wide as what is
believed, which may be off; a search's is tempered, and wider already."""
_STEP = 0.003
"""Of the range, by which places are moved besides: a posterior has few."""
_NARROWED = 0.7
"""Share of its deviation that a parameter has after a round, below which another round tells more."""
_ALIKE = 2.0
"""Deviations by which two answers may differ by chance."""
_MARGIN = 0.05
"""Of the range that the rigs fill, beyond which nothing is said."""
_TRIES = 20
_RIDGE = 0.1
"""Of one rig that lies a deviation away: keeps slopes small that hardly any rig tells."""
_FEWEST = 16
"""Rigs from which straight lines in a few coordinates can be told from their scatter."""


@dataclass(frozen=True, slots=True)
class Focus:
    """Rigs about one explanation: `places` (n, parameters) in its unit cube, `rigs` (n, numbers).

    `low` and `high` bound the part of the cube that they fill.
    """

    hypothesis: Hypothesis
    low: Array
    high: Array
    places: Array
    rigs: Array
    moments: Moments
    following: Following

    def posterior(self, measured: Blocks, worth: Array, rng: np.random.Generator) -> Posterior:
        """What `measured` blocks (n, numbers), of each feature `worth` so many, say within the bounds."""
        response = self.following.response(worth)
        seen = self.following.summary(self.moments(measured)) - response.centre

        def log_likelihood(v: Array) -> Array:
            u = self.low + (self.high - self.low) * v
            off = seen - self._local(u) @ response.slope.T
            logs = -0.5 * np.sum(off @ response.precision * off, axis=1)
            return np.where(allowed_by(self.hypothesis, values_of(self.hypothesis, u)), logs, -1e12)

        found = integrate(log_likelihood, len(self.low), rng)
        return replace(found, places=self.low + (self.high - self.low) * found.places)

    def _local(self, u: Array) -> Array:
        return _standard(self.hypothesis, u, self.places)

    def rigs_at(self, values: Array) -> Array:
        """Fingerprints (n, numbers) as if all rigs had these parameters: moved there along straight lines."""
        z, slopes = self._slopes()
        return np.asarray(self.rigs + (self._at(values[None]) - z) @ slopes)

    def moved(self, best: Array, values: Array) -> Array:
        """How far rigs of parameters (n, parameters) lie from those of the best, shape (n, numbers)."""
        _, slopes = self._slopes()
        return np.asarray((self._at(values) - self._at(best[None])) @ slopes)

    def _at(self, values: Array) -> Array:
        return self._local(places_of(self.hypothesis, values))

    def _slopes(self) -> tuple[Array, Array]:
        z, apart = self._local(self.places), self.rigs - self.rigs.mean(axis=0)
        return z, np.linalg.solve(z.T @ z + _RIDGE * np.eye(z.shape[1]), z.T @ apart)


def refocused(
    ranked: Ranked,
    measured: Blocks,
    moments: Moments,
    told: Sequence[float],
    count: int,
    execute: Execute,
    rng: np.random.Generator,
    library: Library,
) -> tuple[Ranked, Focus | None]:
    """What `measured` blocks (n, numbers) say of an explanation's parameters, by rounds of `count` rigs.

    The rigs go into the `library` too: what each run says alone, or a search that goes on, learns of them.
    `told`: how many blocks of each run they are worth; empty: as many as there are. Where there are no
    parameters, too few rigs came out or these tell less than is known, the explanation stays as it was.
    """
    focus: Focus | None = None
    size = sum(len(cause.parameters) for cause in ranked.hypothesis)
    rigs = _Rigs(np.zeros((0, size)), np.zeros((0, _BLOCKS, measured.shape[1]), np.float32))
    worth = moments.worth(told, len(measured))
    for wider in _WIDER if ranked.hypothesis else ():
        rigs = rigs.about(_drawn(ranked, wider, count, rng), ranked.hypothesis, execute, rng, library)
        if len(rigs.places) < _FEWEST or not _standard(ranked.hypothesis, rigs.places, rigs.places).size:
            break  # which of several it is may be all that there is to tell, and be told
        before, about = _deviations(ranked), _focused(ranked.hypothesis, rigs, moments, rng)
        found = replace(ranked, posterior=about.posterior(measured, worth, rng))
        after, moved = _deviations(found), np.abs(_middle(found) - _middle(ranked))
        if np.all(after > before / _NARROWED) and np.all(moved < _ALIKE * after):
            break  # they tell less than is known, and nothing else
        ranked, focus = found, about
        if np.all(after > _NARROWED * before):
            break
    return ranked, focus


def _middle(ranked: Ranked) -> Array:
    return np.asarray(ranked.posterior.weights @ ranked.posterior.places)


def _deviations(ranked: Ranked) -> Array:
    places, weights = ranked.posterior.places, ranked.posterior.weights
    return np.asarray(np.sqrt(weights @ (places - _middle(ranked)) ** 2))


@dataclass(frozen=True, slots=True)
class _Rigs:
    """Rigs of one hypothesis: `places` (n, parameters), `shown` (n, blocks, numbers)."""

    places: Array
    shown: Blocks

    def about(
        self,
        u: Array,
        hypothesis: Hypothesis,
        execute: Execute,
        rng: np.random.Generator,
        library: Library,
    ) -> _Rigs:
        """Rigs at new places (n, parameters), and those of these that lie among them."""
        order = order_of({hypothesis: values_of(hypothesis, u)}, rng, blocks=_BLOCKS, together=1)
        every = execute(order.draws)
        library.add(order, every)
        places, shown = [], []
        for cases, observed in zip(order.cases, every, strict=True):
            for (_, values), blocks in zip(cases, observed, strict=bool(observed)):
                if blocks is not None:
                    places.append(places_of(hypothesis, values[None])[0])
                    shown.append(blocks)
        if not places:
            return _Rigs(self.places[:0], self.shown[:0])
        new = np.array(places)
        among = np.all((self.places >= new.min(axis=0)) & (self.places <= new.max(axis=0)), axis=1)
        return _Rigs(np.concatenate([new, self.places[among]]), np.concatenate([shown, self.shown[among]]))


def _focused(hypothesis: Hypothesis, rigs: _Rigs, moments: Moments, rng: np.random.Generator) -> Focus:
    known, fingerprints = rigs.places, rigs.shown.astype(np.float64)
    following = followed(_standard(hypothesis, known, known), moments(fingerprints), moments, rng)
    low, high = known.min(axis=0), known.max(axis=0)
    margin = _MARGIN * (high - low) + _STEP
    return Focus(
        hypothesis, np.clip(low - margin, 0.0, 1.0), np.clip(high + margin, 0.0, np.nextafter(1.0, 0.0)),
        known, fingerprints[:, 0], moments, following,
    )  # fmt: skip


def _drawn(ranked: Ranked, wider: float, count: int, rng: np.random.Generator) -> Array:
    """Places about the posterior's, on the same side of what a parameter may not be as its best."""
    hypothesis, wide = ranked.hypothesis, ranked.posterior.tempered(wider)
    best = places_of(hypothesis, ranked.best()[None])
    kept = np.zeros((0, best.shape[1]))
    for _ in range(_TRIES):
        u = wide.sample(count, rng)
        u = np.clip(u + _STEP * rng.standard_normal(u.shape), 0.0, np.nextafter(1.0, 0.0))
        fits = allowed_by(hypothesis, values_of(hypothesis, u)) & on_side_of(best, hypothesis, u)
        kept = np.concatenate([kept, u[fits]])[:count]
    return kept


def on_side_of(place: Array, hypothesis: Hypothesis, u: Array) -> NDArray[np.bool_]:
    """Which places (n, parameters) lie in the same intervals of their parameters as one (1, parameters)."""
    parts = np.array([len(p.intervals) for cause in hypothesis for p in cause.parameters])
    return np.asarray(np.all(np.floor(u * parts) == np.floor(place * parts), axis=1))


def _standard(hypothesis: Hypothesis, u: Array, known: Array) -> Array:
    """Coordinates of places, in deviations of those that are known."""
    coordinates, own = (coordinates_of(hypothesis, values_of(hypothesis, each)) for each in (u, known))
    deviation = own.std(axis=0)
    told = deviation > 1e-9
    return np.asarray((coordinates - own.mean(axis=0))[:, told] / deviation[told])
