"""What the best hypothesis leaves of a measurement, by rigs about it; and what leaves less beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.belief import Unexplained, unexplained
from sim_twin.diagnosis.beside import with_others
from sim_twin.diagnosis.gap import GapMeasure
from sim_twin.diagnosis.judging import rigs_with
from sim_twin.diagnosis.refocus import Focus, refocused
from sim_twin.diagnosis.search import Ranked, Search
from sim_twin.diagnosis.subject import Execute

Array = NDArray[np.float64]
_NEAREST = 12
_OPEN = 0.2
"""Probability of something unknown from which on more is looked for beside what was found, and below which
what comes of that is believed."""
_LEFT = 0.1
"""Of what was believed of the others, what is left once more than they say was found."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """The best hypothesis, its `focus` where it has one, `like` rigs (n, numbers), and what these leave."""

    best: Ranked
    focus: Focus | None
    like: Array
    left: Unexplained


@dataclass(frozen=True, slots=True)
class Explaining:
    """Explains the measurement of a `search` by rounds of `rigs`, which `execute` simulates."""

    search: Search
    attribution: Attribution
    measure: GapMeasure
    rigs: int
    execute: Execute
    rng: np.random.Generator

    def explained(self, ranked: Ranked) -> Explanation:
        """What rigs about it leave, its parameters being those that they tell."""
        search = self.search
        best, focus = refocused(
            ranked, search.measured, self.attribution.moments, search.told,
            self.rigs * max(1, len(ranked.hypothesis)), self.execute, self.rng, search.library,
        )  # fmt: skip
        like = self._like(best, focus)
        healthy = not best.hypothesis
        left = unexplained(self.attribution, self.measure, like, search.measured, healthy=healthy)
        return Explanation(best, focus, like, left)

    def _like(self, best: Ranked, focus: Focus | None) -> Array:
        """Fingerprints (n, numbers) of rigs as the best hypothesis says; the nearest known if there are none.

        Healthy ones are simulated anew, too: directions, scatters and floors were made of those that are
        known, so that these lie nearer to the twin than any other rig.
        """
        if focus is not None:
            return focus.rigs_at(best.best())
        simulated = rigs_with({best.hypothesis: best.best()}, self.rigs, self.execute, self.rng)
        if best.hypothesis in simulated:
            return simulated[best.hypothesis]
        library = self.search.library
        if not library.count(best.hypothesis):
            raise SimulationFailed("no rig with it was simulated", "give it more time")
        known = np.array([each[0] for each in library.fingerprints(best.hypothesis)], dtype=np.float64)
        if not best.hypothesis:
            return known
        values = library.values(best.hypothesis)
        far = np.sum(((values - best.best()) / (values.std(axis=0) + 1e-12)) ** 2, axis=1)
        return known[np.argsort(far)[:_NEAREST]]

    def leaves_open(self, found: Explanation) -> bool:
        """Whether what was found is not all that there is, by rigs about it."""
        return found.left.unknown > _OPEN

    def completed(self, found: Explanation) -> Explanation:
        """What was found, or with it what acts beside it, if that leaves less unknown."""
        if not self.leaves_open(found):
            return found
        for joint in with_others(self.search, found.best, self.rng):
            try:
                tried = self.explained(joint)
            except SimulationFailed:
                break  # there is no time for it: what was found stands
            if tried.focus is not None and not self.leaves_open(tried):
                return tried
        return found

    def believed(self, ranked: Sequence[Ranked], found: Explanation) -> list[Ranked]:
        """The ranking once an explanation was found that needs more than the first of it says."""
        if found.best.hypothesis == ranked[0].hypothesis:
            return [found.best, *ranked[1:]]
        others = [replace(each, probability=_LEFT * each.probability) for each in ranked]
        return [replace(found.best, probability=1 - _LEFT), *others]
