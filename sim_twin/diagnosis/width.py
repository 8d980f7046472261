"""What would be believed if healthy rigs were narrower or wider than their subject says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.belief import belief_of, unexplained, verdict_of
from sim_twin.diagnosis.cause import Hypothesis
from sim_twin.diagnosis.gap import GapMeasure
from sim_twin.diagnosis.search import Ranked, Search, believed

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AtWidth:
    """What is believed where healthy rigs scatter `width` times as much; `name` is the likeliest effect's."""

    width: float
    none: float
    unknown: float
    effect: float
    name: str

    @property
    def verdict(self) -> str:
        """The most probable of "none", "effect" and "unknown"."""
        return verdict_of(self.none, self.effect, self.unknown)


@dataclass(frozen=True, slots=True)
class _Wider(Attribution):
    """The same directions with `width` times the scatter as the unit."""

    width: float = 1.0

    def place(self, fingerprints: NDArray[np.floating]) -> Array:
        return Attribution.place(self, fingerprints) / self.width

    def response(self, hypothesis: Hypothesis, values: Array) -> tuple[Array, Array]:
        mean, excess = Attribution.response(self, hypothesis, values)
        return mean / self.width, excess / self.width**2


def at_width(
    width: float,
    search: Search,
    attribution: Attribution,
    ranked: list[Ranked],
    measure: GapMeasure,
    like_rigs: Callable[[Ranked], Array],
) -> AtWidth:
    """Weigh all hypotheses anew; nothing but `like_rigs` (n, numbers) of another best one is simulated."""
    held = {each.name: getattr(attribution, each.name) for each in fields(attribution)}
    wider = _Wider(**held, width=width)
    again = believed(search.weigh(wider, [each.hypothesis for each in ranked]))
    like = like_rigs(again[0])
    like = like.mean(axis=0) + width * (like - like.mean(axis=0))
    floor = replace(measure, floor=width * measure.floor)
    left = unexplained(wider, floor, like, search.measured, healthy=not again[0].hypothesis)
    belief = belief_of(wider, again, left)
    name = max(belief.of_effects, key=lambda each: belief.of_effects[each], default="")
    return AtWidth(width, belief.none, belief.unknown, belief.effect, name)
