"""Fits what a healthy rig may differ by to what reference runs show, so that its twin is matched.

Where the tolerances of simulated healthy rigs lie is regressed on their fingerprints. What that regression
makes of a fingerprint is a summary of it (Fearnhead and Prangle 2012, doi:10.1111/j.1467-9868.2011.01010.x),
nearly linear in the tolerances and normally scattered: so their posterior is normal, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.discrepancy import learned
from sim_twin.diagnosis.space import Moments, Space, space_of
from sim_twin.diagnosis.subject import Draw, Observed
from sim_twin.healthy import Matched, drawn_places

Array = NDArray[np.float64]
SimulateAll: TypeAlias = Callable[[Sequence[Draw]], Sequence[Observed]]
_BLOCKS = 2
_DIRECTIONS = 40
_RARE = 0.99
_PENALTIES = np.geomspace(1e-3, 100.0, 26)
"""In mean squares of healthy features."""
_TOLD = 3.0
"""Standard errors of a correlation from which on it is no chance."""
_LEAST_SCATTER = 0.05
_SUSPICIOUS, _IMPOSSIBLE = 3.0, 4.0
_FAR = 1.5


@dataclass(frozen=True, slots=True)
class Rigs:
    """Simulated healthy rigs: `places` (n, tolerances), `features` of their blocks (n, blocks, features)."""

    names: tuple[str, ...]
    places: Array
    features: Array


@dataclass(frozen=True, slots=True)
class Match:
    """What reference runs say of their rig's tolerances.

    `misfit` is how far the runs lie from healthy rigs, where 1 is as far as one healthy rig in a hundred.
    """

    matched: Matched
    misfit: float

    @property
    def healthy(self) -> bool:
        """Whether a healthy rig may have made these runs."""
        return self.misfit < _FAR and bool(np.max(np.abs(self.matched.mean)) < _IMPOSSIBLE)

    @property
    def suspicious(self) -> tuple[str, ...]:
        """Tolerances of which the runs ask for more than three standard deviations."""
        far = np.abs(self.matched.mean) > _SUSPICIOUS
        return tuple(name for name, is_far in zip(self.matched.names, far, strict=True) if is_far)


def healthy_draws(count: int, rng: np.random.Generator) -> list[Draw]:
    """`count` healthy rigs to be simulated."""
    return [Draw((), int(rng.integers(2**62)), blocks=_BLOCKS) for _ in range(count)]


def match(
    campaign: Campaign,
    measured: NDArray[np.float32],
    simulate: SimulateAll,
    count: int,
    rng: np.random.Generator,
    told: Sequence[float] = (),
    known_healthy: bool = False,
) -> Match:
    """Match the campaign's rig to its `measured` fingerprints (blocks, numbers), by `count` simulated rigs.

    `told`: how many blocks of each run they are worth; empty: as many as there are. Of a rig that is
    `known_healthy`, what lies beyond healthy rigs is a discrepancy of the twin, and is matched no further.

    `simulate` has the campaign observe draws; () stands for one that there was no time for. Raises
    SimulationFailed where too few came out.
    """
    draws = healthy_draws(count, rng)
    observed, moments = simulate(draws), Moments(campaign.layout)
    found = match_among(simulated_rigs(campaign, draws, observed), moments, measured, told)
    if not known_healthy or found.healthy:
        return found
    beyond = learned(campaign.layout, measured, fingerprints_of(observed))
    other = replace(campaign, discrepancies=beyond)
    rigs = simulated_rigs(other, draws, other.as_they_differ(draws, observed))
    return match_among(rigs, moments, measured, told)


def fingerprints_of(observed: Sequence[Observed]) -> NDArray[np.float32]:
    """Those of the rigs that came out, (n, blocks, numbers)."""
    return np.array([each[0] for each in observed if each and each[0] is not None])


def simulated_rigs(campaign: Campaign, draws: Sequence[Draw], observed: Sequence[Observed]) -> Rigs:
    """What became of `healthy_draws`, less those that failed; SimulationFailed where few are left."""
    moments, twin = Moments(campaign.layout), campaign.runs[0].twin
    kept = []
    for draw, shown in zip(draws, observed, strict=True):
        if shown and shown[0] is not None:
            # where the rig lies: the campaign draws it from the same seed
            rng = np.random.default_rng(SeedSequence(draw.seed, spawn_key=(0,)))
            kept.append((drawn_places(twin, twin.model.healthy_spread(twin), rng), moments(shown[0])))
    twin = campaign.runs[0].twin
    names = tuple(each.name for each in twin.model.lasting_tolerances(twin))
    if len(kept) < 2 * len(names):
        raise SimulationFailed(
            f"only {len(kept)} of {len(draws)} healthy rigs could be simulated",
            f"a calibration of {len(names)} tolerances needs {2 * len(names)} at least",
        )
    places, features = zip(*kept, strict=True)
    return Rigs(names, np.array(places), np.array(features))


def matched_campaign(campaign: Campaign, matched: Matched) -> Campaign:
    """The same runs of a twin that was matched: nominal at the means, healthy rigs by what was left open."""
    runs = tuple(replace(run, twin=run.twin.model.matched(run.twin, matched)) for run in campaign.runs)
    return replace(campaign, runs=runs)


def match_among(
    rigs: Rigs, moments: Moments, measured: NDArray[np.floating], told: Sequence[float] = ()
) -> Match:
    """Match `measured` fingerprints (blocks, numbers) by what simulated healthy rigs show; see `match`."""
    space = space_of(rigs.features[:, 0], rigs.features[:0, 0], moments.tolerance, _DIRECTIONS)
    shown = space.scaled(rigs.features)
    seen = space.scaled(moments(measured))
    regression = regressed(shown.mean(axis=1), rigs.places)
    response = response_of(rigs.places, regression, shown, moments.worth(told, len(seen)))
    place = regression(seen.mean(axis=0)) - response.centre
    of_summary = response.misfit(place[None])[0] / np.quantile(response.misfit(response.of_rigs), _RARE)
    # how far the fingerprint lies from healthy rigs' in the directions in which these differ most
    centre = shown.mean(axis=1).mean(axis=0)
    along = (shown.mean(axis=1) - centre) @ space.basis
    scatter = np.sqrt(np.mean(along**2, axis=0))
    squares = np.mean((along / scatter) ** 2, axis=1)
    off = (seen.mean(axis=0) - centre) @ space.basis / scatter
    misfit = max(of_summary, float(np.mean(off**2) / np.quantile(squares, _RARE)))
    return Match(response.posterior(place, rigs.names), float(misfit))


@dataclass(frozen=True, slots=True)
class Summary:
    """What a run shows of places (n,): `place` (..., told) is `slope` (told, n) @ places + scatter.

    `scatter` is its covariance.
    """

    place: Array
    slope: Array
    scatter: Array

    @property
    def information(self) -> Array:
        """Inverse covariance of the places by this alone, (n, n)."""
        return np.asarray(self.slope.T @ np.linalg.solve(self.scatter, self.slope))

    @property
    def pull(self) -> Array:
        """`information` @ where they lie, (..., n)."""
        return np.asarray(np.linalg.solve(self.scatter, self.place.T).T @ self.slope)


def summary_of(rigs: Rigs, moments: Moments, measured: NDArray[np.floating]) -> Summary:
    """What `measured` fingerprints (blocks, numbers) show, by what simulated healthy rigs do."""
    space = space_of(rigs.features[:, 0], rigs.features[:0, 0], moments.tolerance, _DIRECTIONS)
    shown, seen = space.scaled(rigs.features), space.scaled(moments(measured))
    regression = regressed(shown.mean(axis=1), rigs.places)
    response = response_of(rigs.places, regression, shown, moments.worth((), len(seen)))
    return response.summary(regression(seen.mean(axis=0)) - response.centre)


@dataclass(frozen=True, slots=True)
class Regression:
    """From scaled features to where the tolerances lie that they tell.

    `left_out` (n, told tolerances) is what the others make of each rig.
    """

    centre: Array
    mean: Array
    weights: Array
    left_out: Array

    def __call__(self, features: Array) -> Array:
        return np.asarray((features - self.centre) @ self.weights + self.mean)


def regressed(features: Array, places: Array) -> Regression:
    """Ridge regression, by the penalty that tells most of rigs that were left out."""
    centre, mean = features.mean(axis=0), places.mean(axis=0)
    x, z = features - centre, places - mean
    values, vectors = np.linalg.eigh(x @ x.T / x.shape[1])
    turned = vectors.T @ z
    found = []
    for penalty in _PENALTIES:
        share = values / (values + penalty)
        leverage = 1 / len(z) + (vectors**2) @ share
        left_out = z - (z - (vectors * share) @ turned) / (1 - leverage[:, None])
        spread = left_out - left_out.mean(axis=0)
        size = np.sqrt(np.sum(spread**2, axis=0) * np.sum(z**2, axis=0)) + 1e-12
        correlation = np.clip(np.sum(spread * z, axis=0) / size, 0.0, 0.999)  # none where it is negative
        found.append((-np.sum(np.log(1 - correlation**2)), penalty, left_out, correlation))
    _, penalty, left_out, correlation = max(found, key=lambda each: each[0])
    weights = x.T @ (vectors / (values + penalty)) @ turned / x.shape[1]
    # Where nothing tells, the guess is the mean of the others, which gives away the one left out.
    told = correlation >= min(_TOLD / np.sqrt(len(z)), correlation.max())
    return Regression(centre, mean[told], weights[:, told], (left_out + mean)[:, told])


@dataclass(frozen=True, slots=True)
class Response:
    """Summaries are `centre` + `slope` @ places + scatter; `precision` is the inverse of its covariance."""

    centre: Array
    slope: Array
    precision: Array
    of_rigs: Array

    def posterior(self, place: Array, names: tuple[str, ...]) -> Matched:
        """Where the tolerances lie for a summary, less the centre; prior 0 and 1."""
        pull = self.slope.T @ self.precision
        covariance = np.asarray(np.linalg.inv(np.eye(len(names)) + pull @ self.slope), np.float64)
        return Matched(names, covariance @ pull @ place, covariance)

    def summary(self, place: Array) -> Summary:
        """Of a place (..., told), less the centre."""
        return Summary(place, self.slope, np.asarray(np.linalg.inv(self.precision)))

    def misfit(self, places: Array) -> Array:
        """Mean squares of summaries (n, told), less the centre, in healthy scatter; shape (n,)."""
        spread = self.slope @ self.slope.T + np.linalg.inv(self.precision)
        return np.asarray(np.mean(places * np.linalg.solve(spread, places.T).T, axis=1))


def response_of(places: Array, regression: Regression, shown: Array, blocks: Array) -> Response:
    """How summaries of so many measured `blocks` of each feature follow the places."""
    count, size = regression.left_out.shape
    given = np.column_stack([np.ones(count), places])
    solved = np.linalg.pinv(given)
    fit = solved @ regression.left_out
    leverage = np.sum(given * solved.T, axis=1)
    residual = (regression.left_out - given @ fit) / (1 - leverage[:, None])
    scatter = of_rigs = residual.T @ residual / count
    least = _LEAST_SCATTER * float(np.median(np.linalg.eigvalsh(of_rigs)))
    # what measured summaries scatter more than simulated ones, being of fewer blocks, or less, of more
    more = 1 / blocks - 1 / _BLOCKS
    for sign in (1, -1):
        apart = (np.sqrt(np.maximum(sign * more, 0.0)) * (shown[:, 0] - shown[:, 1])) @ regression.weights
        scatter = scatter + sign * apart.T @ apart / (2 * len(apart))
    slope = fit[1:].T
    # James and Stein: what no more than chance explains, is nothing.
    strength = count * np.sum(slope * (_inverse(of_rigs, least) @ slope), axis=0)
    slope = slope * np.maximum(0.0, 1 - size / np.maximum(strength, 1e-12))
    return Response(fit[0], slope, _inverse(scatter, least), regression.left_out - fit[0])


def _inverse(scatter: Array, least: float) -> Array:
    """Of a covariance, of which no direction has less than the `least`."""
    values, vectors = np.linalg.eigh(scatter)
    return np.asarray((vectors / np.maximum(values, least)) @ vectors.T)


@dataclass(frozen=True, slots=True)
class Following:
    """How rigs' features follow their `local` places (n, values); `shown` (n, blocks, features) is scaled."""

    space: Space
    regression: Regression
    local: Array
    shown: Array

    def summary(self, features: Array) -> Array:
        """Of features (blocks, features): where the places lie that they tell."""
        return self.regression(self.space.scaled(features).mean(axis=0))

    def response(self, blocks: Array) -> Response:
        """How summaries of so many measured `blocks` of each feature follow the places."""
        return response_of(self.local, self.regression, self.shown, blocks)


def followed(local: Array, features: Array, moments: Moments, rng: np.random.Generator) -> Following:
    """How rigs' features (n, blocks, features) follow their local places (n, values)."""
    space = space_of(features[:, 0], features[:0, 0], moments.tolerance, _DIRECTIONS)
    shown = space.scaled(features) + _between_programs(moments, space.scale, len(features), rng)[:, None]
    return Following(space, regressed(shown.mean(axis=1), local), local, shown)


def _between_programs(moments: Moments, scale: Array, count: int, rng: np.random.Generator) -> Array:
    """What two careful programs may differ by, drawn for each rig; half of it is common to a kind."""
    share = np.sqrt(0.5) * moments.tolerance / scale
    alone = rng.standard_normal((count, len(share)))
    common = rng.standard_normal((count, int(moments.kinds.max()) + 1))[:, moments.kinds]
    return np.asarray(share * (alone + common))
