"""Pairs at a glance: ranked as their evidence ranks them, each cause evaluated once."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.cause import Cause
from sim_twin.effects import Parameter

Array = NDArray[np.float64]
DIRECTIONS = 6


def test_a_glance_at_pairs_ranks_them_as_their_evidence_does() -> None:
    asked: list[int] = []

    def emulator(direction: int) -> Any:
        def response(coordinates: Array) -> tuple[Array, Array]:
            asked.append(direction)
            mean = np.zeros((len(coordinates), DIRECTIONS))
            mean[:, direction] = 8 * coordinates[:, 0]
            return mean, np.full(mean.shape, 0.1)

        return response

    causes = [Cause(f"cause {k}", "place", (Parameter("size", "", ((0.1, 1.0),)),)) for k in range(4)]
    emulators = {(cause,): emulator(k) for k, cause in enumerate(causes)}
    nothing: Any = None
    seen = Attribution(nothing, nothing, nothing, np.zeros(DIRECTIONS), np.ones(DIRECTIONS), emulators)
    measured = np.array([3.0, 5.0, 1.0, 0.0, 0.5, 0.0])
    pairs = list(combinations(causes, 2))
    rough = seen.glances(pairs, measured, np.random.default_rng(1))
    assert sorted(asked) == [0, 1, 2, 3]
    exact = [seen.posterior(pair, measured, np.random.default_rng(2)).log_evidence for pair in pairs]
    assert list(np.argsort(rough)) == list(np.argsort(exact))
    # less what a pair that was not simulated may differ by from the sum
    assert np.abs(rough - exact).max() < 0.5
