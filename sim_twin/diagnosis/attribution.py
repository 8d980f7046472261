"""How well each hypothesis explains a measured fingerprint: synthetic likelihoods over emulated responses.

Wood 2010, doi:10.1038/nature09319: the numbers of a fingerprint, averages over many cycles, scatter about
their mean as a normal distribution; mean and scatter come from simulated rigs. Here the mean is a smooth
function of the effect's parameters, and the tails are a t distribution's, since both are estimates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from sim_twin.diagnosis.cause import Hypothesis, allowed_by, drawn, parts_of, values_of
from sim_twin.diagnosis.emulator import Emulator
from sim_twin.diagnosis.posterior import Posterior, integrate
from sim_twin.diagnosis.space import Moments, Space

Array = NDArray[np.float64]
LogLikelihood: TypeAlias = Callable[[Array], Array]
_FREEDOM = 20.0
_FORBIDDEN = -1e12
_POINTS = 120
TEMPER = 3.0
"""A synthetic likelihood is too sure of itself by about this factor in its logarithm: directions are not
quite independent, scatters are estimates, and other programs differ a little. Set where twins' own draws,
left out of the library, were about as often right as they were believed."""
_INTERPLAY = 0.02
"""Share of the smaller of two responses' squares by which an unsimulated pair may differ from their sum."""


@dataclass(frozen=True, slots=True)
class Attribution:
    """What a library says: in whitened directions, where the scatter of one healthy block is 1.

    `scatter` is the variance of a mean over the measured blocks, of each direction, turned so that they are
    independent.
    """

    moments: Moments
    space: Space
    whitener: Array
    healthy: Array
    scatter: Array
    emulators: dict[Hypothesis, Emulator]

    def place(self, fingerprints: NDArray[np.floating]) -> Array:
        """Where fingerprints (..., numbers) lie, shape (..., directions), a healthy rig's mean at 0."""
        return np.asarray(self.space(self.moments(fingerprints)) @ self.whitener - self.healthy)

    def response(self, hypothesis: Hypothesis, values: Array) -> tuple[Array, Array]:
        """Means and excess variances of a hypothesis at parameters (n, parameters), both (n, directions)."""
        if not hypothesis:
            nothing = np.zeros((len(values), len(self.scatter)))
            return nothing, nothing
        if len(hypothesis) == 1:
            return self._emulated(hypothesis, values)
        parts = zip(hypothesis, parts_of(hypothesis), strict=True)
        singles = [self._emulated((cause,), values[:, at]) for cause, at in parts]
        mean = np.sum([single for single, _ in singles], axis=0)
        if hypothesis in self.emulators:
            correction, excess = self._emulated(hypothesis, values)
            return mean + correction, excess
        smaller = np.min([np.mean(single**2, axis=1, keepdims=True) for single, _ in singles], axis=0)
        return mean, np.sum([excess for _, excess in singles], axis=0) + _INTERPLAY * smaller

    def glances(
        self, pairs: Sequence[Hypothesis], measured: Array, rng: np.random.Generator, places: int = 256
    ) -> Array:
        """Roughly the logarithms of pairs' evidence, (pairs,), to tell which are worth a closer look.

        Every cause is evaluated once, at places spread evenly; of two, all places of one go with all of the
        other. Excess variances are taken at their mean.
        """
        seen: dict[Hypothesis, tuple[Array, Array]] = {}
        for (cause,) in dict.fromkeys((cause,) for pair in pairs for cause in pair):
            mean, excess = self._emulated((cause,), drawn((cause,), places, rng))
            seen[cause,] = mean, excess.mean(axis=0)
        found = []
        for pair in pairs:
            (one, more), (other, still) = (seen[cause,] for cause in pair)
            variance = self.scatter + more + still
            a, b = (measured - one) / np.sqrt(variance), other / np.sqrt(variance)
            squares = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1)[None] - 2 * a @ b.T
            logs = self._student(np.maximum(squares, 0.0), 0.5 * float(np.sum(np.log(variance))))
            found.append(float(logsumexp(logs / TEMPER)) - 2 * np.log(places))
        return np.array(found)

    def _student(self, squares: Array, spread: Array | float) -> Array:
        """Logarithm of Student's density in as many directions, by squares and half the log variances."""
        size = len(self.scatter)
        level = gammaln((_FREEDOM + size) / 2) - gammaln(_FREEDOM / 2)
        level -= size / 2 * np.log(_FREEDOM * np.pi)
        return np.asarray(level - spread - 0.5 * (_FREEDOM + size) * np.log1p(squares / _FREEDOM))

    def _emulated(self, hypothesis: Hypothesis, values: Array) -> tuple[Array, Array]:
        return self.emulators[hypothesis](coordinates_of(hypothesis, values))

    def log_likelihood(self, hypothesis: Hypothesis, measured: Array) -> LogLikelihood:
        """Tempered, of places in the unit cube of the hypothesis, for a measured place (directions,)."""

        def of(u: Array) -> Array:
            values = values_of(hypothesis, u)
            mean, excess = self.response(hypothesis, values)
            variance = self.scatter + excess
            squares = np.sum((measured - mean) ** 2 / variance, axis=1)
            logs = self._student(squares, 0.5 * np.sum(np.log(variance), axis=1))
            return np.where(allowed_by(hypothesis, values), logs / TEMPER, _FORBIDDEN)

        return of

    def misfit(self, hypothesis: Hypothesis, values: Array, measured: Array) -> Array:
        """Mean square of what is left of a measured place, in its own scatter and the emulator's; about 1."""
        mean, excess = self.response(hypothesis, values)
        return np.asarray(np.mean((measured - mean) ** 2 / (self.scatter + excess), axis=1))

    def posterior(
        self, hypothesis: Hypothesis, measured: Array, rng: np.random.Generator, effort: float = 1.0
    ) -> Posterior:
        """Posterior of the hypothesis's parameters, and its evidence."""
        dimensions = sum(len(cause.parameters) for cause in hypothesis)
        points = int(effort * _POINTS * max(1, dimensions))
        return integrate(self.log_likelihood(hypothesis, measured), dimensions, rng, 2 * points, points)


def coordinates_of(hypothesis: Hypothesis, values: Array) -> Array:
    """Coordinates of all causes of a hypothesis, side by side."""
    parts = zip(hypothesis, parts_of(hypothesis), strict=True)
    return np.concatenate([cause.coordinates(values[:, at]) for cause, at in parts], axis=1)
