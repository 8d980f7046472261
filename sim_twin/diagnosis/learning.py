"""Turns a library into an attribution: directions, scatters, emulators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution, coordinates_of
from sim_twin.diagnosis.cause import Hypothesis
from sim_twin.diagnosis.emulator import Emulator, fitted
from sim_twin.diagnosis.library import Library
from sim_twin.diagnosis.space import Moments, space_of

Array = NDArray[np.float64]
_DIRECTIONS = 80
_SHARE = 6
"""Healthy and left-out fingerprints for each direction, at least."""
FEWEST = 6
"""Observations of a hypothesis from which its responses can be emulated."""
_SHRINK = 0.05
_FARTHEST = 8.0
_LEAST_SCATTER = 0.1


def learned(library: Library, moments: Moments, blocks: int) -> Attribution:
    """Make the most of a library for a measurement of so many `blocks`."""
    healthy = [moments(each) for each in library.fingerprints(())]
    first = np.array([each[0] for each in healthy])
    known = {
        h: _features(library, moments, h) for h in library.hypotheses if h and library.count(h) >= FEWEST
    }
    others = np.concatenate([first[:0], *known.values()])
    space = space_of(first, others, moments.tolerance, _directions(len(first) + len(others)))

    tolerated = space.tolerated(moments)
    rough = _whitening(space(first) - space(first).mean(axis=0), tolerated)
    y = {h: space(features) @ rough for h, features in known.items()}
    centre = (space(np.concatenate(healthy)) @ rough).mean(axis=0)
    left = [space(first) @ rough - centre]
    left += [_emulator(library, h, y[h] - centre).left_out for h in known if len(h) == 1]
    residuals = np.clip(np.concatenate(left), -_FARTHEST, _FARTHEST)
    whitener = rough @ _whitening(residuals, rough.T @ tolerated @ rough)

    scatter, turn = _scatter([space(each) @ whitener for each in healthy], blocks)
    whitener = whitener @ turn
    centre = (space(np.concatenate(healthy)) @ whitener).mean(axis=0)
    places = {h: space(features) @ whitener - centre for h, features in known.items()}
    singles: dict[Hypothesis, Emulator] = {
        h: _emulator(library, h, place) for h, place in places.items() if len(h) == 1
    }
    alone = Attribution(moments, space, whitener, centre, scatter, singles)
    pairs = {
        h: _emulator(library, h, place - alone.response(h, library.values(h))[0])
        for h, place in places.items()
        if len(h) > 1 and all((cause,) in singles for cause in h)
    }
    return replace(alone, emulators={**singles, **pairs})


def _directions(fingerprints: int) -> int:
    return max(4, min(_DIRECTIONS, fingerprints // _SHARE))


def _features(library: Library, moments: Moments, hypothesis: Hypothesis) -> Array:
    return np.array([moments(each[0]) for each in library.fingerprints(hypothesis)])


def _emulator(library: Library, hypothesis: Hypothesis, places: Array) -> Emulator:
    return fitted(coordinates_of(hypothesis, library.values(hypothesis)), places)


def _whitening(residuals: Array, tolerated: Array) -> Array:
    """A matrix that makes residuals (n, directions) independent and of variance 1, small variances lifted.

    What is `tolerated` between programs (a covariance) counts as scatter, too.
    """
    covariance = residuals.T @ residuals / len(residuals) + tolerated
    values, vectors = np.linalg.eigh(covariance)
    lifted = (1 - _SHRINK) * np.maximum(values, 0.0) + _SHRINK * np.median(values) + 1e-12
    return np.asarray(vectors / np.sqrt(lifted))


def _scatter(healthy: Sequence[Array], blocks: int) -> tuple[Array, Array]:
    """Variances of means over so many `blocks`, and the turn to directions in which they are independent.

    What differs between the blocks of a rig is averaged, what differs between rigs is not.
    """
    several = [each for each in healthy if len(each) > 1]
    size = healthy[0].shape[1]
    if blocks < 2 or not several:
        return np.ones(size), np.eye(size)
    within = np.concatenate([each - each.mean(axis=0) for each in several])
    freedom = sum(len(each) - 1 for each in several)
    values, vectors = np.linalg.eigh(within.T @ within / freedom)
    return np.maximum(1 - (1 - 1 / blocks) * np.clip(values, 0.0, 1.0), _LEAST_SCATTER), vectors
