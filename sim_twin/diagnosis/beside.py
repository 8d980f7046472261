"""What else is missing: where found effects leave a measurement open, the search anew with them in every rig.

Forward selection (Hastie, Tibshirani and Friedman 2009, The Elements of Statistical Learning, section 3.3.2).
What is not in yet has led the parameters of what was found astray: they are drawn from wide about it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.diagnosis.cause import (
    Cause,
    Hypothesis,
    allowed_by,
    drawn,
    named,
    parts_of,
    places_of,
    values_of,
)
from sim_twin.diagnosis.library import Library
from sim_twin.diagnosis.posterior import Posterior
from sim_twin.diagnosis.refocus import on_side_of
from sim_twin.diagnosis.search import BEFOREHAND, Ranked, Search, in_order
from sim_twin.diagnosis.subject import Draw, Execute, Named, Observed

Array = NDArray[np.float64]
_ABOUT, _WIDER = 0.5, 0.2
"""Share of the places that lie about what was found, of its weights to that power; the rest lies anywhere."""
_PLACES = 400
_DOUBTED = 6
"""So many values are looked at beside an effect."""
_APART = 17
"""Keeps what is drawn of the found effects apart from what else a draw's seed decides."""


def with_others(search: Search, found: Ranked, rng: np.random.Generator) -> Iterator[Ranked]:
    """What was `found` with the most probable of what may act beside it, its parameters as wide as that.

    Values that may have been entered wrongly are looked at first, if the `search` has not; then as many
    motions as it may have are simulated at most: whoever asks again has those spent that were left once one
    of the others led. Nothing where nothing may be added, or where there was no time.
    """
    names = {cause.name for cause in found.hypothesis}
    every = [*(cause for cause in search.causes if not cause.entered), *_doubts_beside(search, found, rng)]
    others = [c for c in every if c not in found.hypothesis and (c.name not in names or c.channel)]
    room = len(BEFOREHAND) - 1 - len(found.hypothesis)
    if not found.hypothesis or room < 1 or not others:
        return
    wide = _wide(found, rng)
    with_found = _With(search.execute, found.hypothesis, wide)
    second = Search(
        search.subject, search.measured, with_found, rng, Library(), search.motions, search.told, others,
        of_longest=search.of_longest, doubting=False,
    )  # fmt: skip
    for look in (second.until_one_leads, second.go_on):
        try:
            _, ranked = look()
        except SimulationFailed:
            return
        if with_found.cut_short:
            return
        added = next(each for each in ranked if 0 < len(each.hypothesis) <= room)
        yield _joined(replace(found, posterior=wide), added, rng)
        if not second.may_go_on:
            return


def _doubts_beside(search: Search, found: Ranked, rng: np.random.Generator) -> list[Cause]:
    """The values that explain most beside the one effect that was found, if they were entered wrongly."""
    if len(found.hypothesis) != 1 or not search.doubt():
        return []
    attribution = search.learn()
    known = [c for c in search.causes if c.entered and (c,) in attribution.emulators]
    pairs = [in_order(found.hypothesis[0], cause) for cause in known if cause not in found.hypothesis]
    if not pairs:
        return []
    place = attribution.place(search.measured).mean(axis=0)
    best = np.argsort(attribution.glances(pairs, place, rng))[::-1][:_DOUBTED]
    return [next(cause for cause in pairs[k] if cause not in found.hypothesis) for k in best]


@dataclass(slots=True)
class _With:
    """Has draws observed with found effects in, whose parameters the seed of each draw decides.

    `cut_short`: there was no time for some.
    """

    execute: Execute
    found: Hypothesis
    posterior: Posterior
    cut_short: bool = False

    def __call__(self, draws: Sequence[Draw]) -> Sequence[Observed]:
        shown = self.execute([self._with_found(draw) for draw in draws])
        self.cut_short |= not all(shown)
        return shown

    def _with_found(self, draw: Draw) -> Draw:
        rng = np.random.default_rng(SeedSequence(draw.seed, spawn_key=(_APART,)))
        [values] = values_of(self.found, self.posterior.sample(1, rng))
        moving, sensing = list[Named](), list[Named]()
        for cause, effect in zip(self.found, named(self.found, values), strict=True):
            (sensing if cause.sensing else moving).append(effect)
        of_sensors = tuple((*sensing, *each) for each in draw.sensing)
        return replace(draw, effects=(*moving, *draw.effects), sensing=of_sensors)


def _wide(found: Ranked, rng: np.random.Generator) -> Posterior:
    """Places about what was found and anywhere, on the same side of what a parameter may not be."""
    hypothesis = found.hypothesis
    about = found.posterior.tempered(_WIDER).sample(int(_ABOUT * _PLACES), rng)
    anywhere = places_of(hypothesis, drawn(hypothesis, _PLACES, rng))
    anywhere = anywhere[on_side_of(places_of(hypothesis, found.best()[None]), hypothesis, anywhere)]
    places = np.concatenate([about, anywhere[: _PLACES - len(about)]])
    places = places[allowed_by(hypothesis, values_of(hypothesis, places))]
    return Posterior(places, np.full(len(places), 1 / len(places)), 0.0)


def _joined(found: Ranked, added: Ranked, rng: np.random.Generator) -> Ranked:
    """Both at once: what is believed of one says nothing of the other yet."""
    every = in_order(*found.hypothesis, *added.hypothesis)
    of_each = {}
    for each in (found, added):
        places = each.posterior.sample(_PLACES, rng)
        parts = zip(each.hypothesis, parts_of(each.hypothesis), strict=True)
        of_each.update({cause: places[:, at] for cause, at in parts})
    places = np.concatenate([of_each[cause] for cause in every], axis=1)
    posterior = Posterior(places, np.full(_PLACES, 1 / _PLACES), added.posterior.log_evidence)
    return Ranked(every, added.probability, posterior, added.misfit)
