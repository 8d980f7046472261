"""Evidence and posterior of a few parameters by adaptive importance sampling.

Population Monte Carlo: Cappe, Guillin, Marin and Robert 2004, doi:10.1198/106186004X12803; all rounds are
kept, weighted by the mixture of their proposals (Cornuet et al. 2012, doi:10.1111/j.1467-9469.2011.00756.x).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_CENTRES = 60
_UNIFORM = 0.15
_LEAST_WIDTH = 2e-3
_NEAREST = 5
"""Places by which the likelihood at another one is told."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter's best value and the interval that holds it with 95 %."""

    value: float
    low: float
    high: float

    def widened(self, times: float, least: float, most: float) -> Estimate:
        """The interval stretched about the value, but not beyond `least` and `most`."""
        low, high = (
            self.value - times * (self.value - self.low),
            self.value + times * (self.high - self.value),
        )
        return Estimate(self.value, max(low, min(least, self.low)), min(high, max(most, self.high)))


@dataclass(frozen=True, slots=True)
class Posterior:
    """Places in the unit cube, (n, dimensions), with `weights` that sum to 1; logarithm of the evidence.

    `logs`, (n,), are the logarithms of the likelihood there, where it is known.
    """

    places: Array
    weights: Array
    log_evidence: float
    logs: Array | None = None

    @property
    def likeliest(self) -> int:
        """Which of the places is."""
        return int(np.argmax(self.weights if self.logs is None else self.logs))

    def central(self, place: Array) -> Array:
        """A middle `place` (dimensions,) if it is as likely as what counts; else one of these.

        Between two peaks, or beside a bend along which parameters go together, there may be nothing.
        """
        if self.logs is None:
            return place
        mean = self.weights @ self.places
        off = self.places - mean
        inverse = np.asarray(np.linalg.pinv(off.T @ (self.weights[:, None] * off)), np.float64)
        nearest = np.argsort(_squares(self.places - place, inverse))[:_NEAREST]
        if np.median(self.logs[nearest]) >= self.weights @ self.logs:
            return place
        return np.asarray(self.places[int(np.argmax(self.logs - 0.5 * _squares(off, inverse)))])

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Some of the places, as often as they weigh."""
        return self.places[rng.choice(len(self.places), count, p=self.weights)]

    def flattened(self, distinct: int) -> Posterior:
        """The same places with weights so even that about `distinct` of them count."""
        weights = self.weights
        for _ in range(40):
            if 1 / np.sum(weights**2) >= min(distinct, 0.5 * len(weights)):
                break
            weights = _power(weights, 0.75)
        return replace(self, weights=weights)

    def tempered(self, power: float) -> Posterior:
        """The same places, their weights to some power."""
        return replace(self, weights=_power(self.weights, power))


def _squares(off: Array, inverse: Array) -> Array:
    """Of distances (n, dimensions) in deviations, (n,)."""
    return np.asarray(np.sum(off @ inverse * off, axis=1))


def _power(weights: Array, power: float) -> Array:
    raised = np.maximum(weights, 1e-300) ** power
    return np.asarray(raised / raised.sum())


def integrate(
    log_likelihood: Callable[[Array], Array],
    dimensions: int,
    rng: np.random.Generator,
    first: int = 600,
    each: int = 300,
    rounds: int = 3,
) -> Posterior:
    """Integrate a likelihood over the unit cube."""
    if dimensions == 0:
        return Posterior(np.zeros((1, 0)), np.ones(1), float(log_likelihood(np.zeros((1, 0)))[0]))
    strata = np.column_stack([rng.permutation(first) for _ in range(dimensions)])
    places = np.asarray((strata + rng.uniform(size=(first, dimensions))) / first)
    logs = log_likelihood(places)
    density = np.full(first, float(first))
    proposals: list[_Kernels] = []
    for _ in range(rounds):
        weights = _weights(logs, density)
        chosen = places[rng.choice(len(places), _CENTRES, p=weights)]
        spread = np.sqrt(np.maximum(weights @ (places - weights @ places) ** 2, 0.0))
        shrunk = _CENTRES ** (-1 / (places.shape[1] + 4))
        kernels = _Kernels(chosen, np.maximum(1.5 * shrunk * spread, _LEAST_WIDTH))
        added = kernels.sample(each, rng)
        before = sum((each * k.density(added) for k in proposals), np.full(each, float(first)))
        density = np.concatenate(
            [density + each * kernels.density(places), before + each * kernels.density(added)]
        )
        places, logs = np.concatenate([places, added]), np.concatenate([logs, log_likelihood(added)])
        proposals.append(kernels)
    top = float(np.max(logs))
    weights = np.exp(logs - top) / density
    total = float(weights.sum())
    return Posterior(places, weights / total, top + float(np.log(total)), logs)


@dataclass(frozen=True, slots=True)
class _Kernels:
    """A mixture of bells about some places, with a share that is uniform."""

    centres: Array
    widths: Array

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        chosen = self.centres[rng.integers(len(self.centres), size=count)]
        moved = chosen + self.widths * rng.standard_normal(chosen.shape)
        moved = 1 - np.abs(1 - np.abs(moved) % 2)  # reflected where it leaves the cube
        anywhere = rng.uniform(size=count) < _UNIFORM
        moved[anywhere] = rng.uniform(size=(int(anywhere.sum()), chosen.shape[1]))
        return np.asarray(np.clip(moved, 0.0, np.nextafter(1.0, 0.0)))

    def density(self, places: Array) -> Array:
        product = np.ones((len(places), len(self.centres)))
        for k, width in enumerate(self.widths):
            here, centres = places[:, k, None], self.centres[None, :, k]
            scale = width * np.sqrt(2 * np.pi)
            images = (centres, -centres, 2 - centres)
            product *= sum(np.exp(-0.5 * ((here - image) / width) ** 2) / scale for image in images)
        return np.asarray(_UNIFORM + (1 - _UNIFORM) * product.mean(axis=1))


def _weights(logs: Array, density: Array) -> Array:
    """Flattened until enough places count."""
    relative = logs - np.max(logs)
    flat = 1.0
    for _ in range(30):
        weights = np.exp(flat * relative) / density
        weights /= weights.sum()
        if 1 / np.sum(weights**2) > _CENTRES / 4:
            break
        flat *= 0.7
    return weights
