"""The way of a diagnosis: search, judge on data that were not fitted, weigh, select."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.arguments import alone, contrasts
from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.belief import Belief, belief_of, contributions, largest, of_a_part
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.cause import Hypothesis, effects_of, is_effect, named, parts_of
from sim_twin.diagnosis.explanation import Explaining, Explanation
from sim_twin.diagnosis.findings import Entered, Findings, Judged
from sim_twin.diagnosis.gap import GapMeasure, gap_measure, shrink_of
from sim_twin.diagnosis.judging import (
    gap_after,
    gap_between,
    halves,
    leads_away,
    moved_by,
    refitted,
    repaired_twins,
    without_idle_partners,
)
from sim_twin.diagnosis.library import FEWEST, Library
from sim_twin.diagnosis.refocus import Focus
from sim_twin.diagnosis.search import Ranked, Search, doubts_of
from sim_twin.diagnosis.separability import inseparable, separability
from sim_twin.diagnosis.subject import Draw, Execute, Observed, Subject
from sim_twin.diagnosis.where import alone_off, not_fitting, where_unknown

Array = NDArray[np.float64]
Blocks = NDArray[np.float32]
_SIMULATING = 0.58
"""Of a budget; the rest goes into what is made of it."""
_CORES = 2
_LEAST_MOTIONS, _MOST_MOTIONS = 180, 3000
_A_SECOND = 6.0
"""Motions for each second of a budget, where more would fit in: about as many as three runs have had. What
they leave unsure, more of them hardly told."""
_JUDGED = 4
_CONFIRMING = 3
"""One in so many motions of the judging goes into rigs of all that the best is held against."""
_FEWEST_ABOUT = 24
"""Rigs about the best explanation in a round: some for each of its parameters, and to tell their scatter."""


@dataclass(frozen=True, slots=True)
class Effort:
    """How often all runs of a campaign may be simulated: for the search, and for the judging after it.

    `doubts` more where no effect explains them. Of the longest run by itself the search would have so many as
    `of_longest` says; none said: as many.

    Fixed beforehand, so that the same seed gives the same answer anywhere.
    """

    search: int
    judge: int
    doubts: int = 0
    of_longest: int = 0

    @property
    def motions(self) -> int:
        return self.search + self.judge

    @property
    def about(self) -> int:
        """Rigs about an explanation in a round."""
        return max(_FEWEST_ABOUT, self.judge // 3)

    @property
    def most(self) -> int:
        """With another search, beside what was found, judged anew, and values that may be entered wrongly."""
        return 2 * self.motions + self.doubts


def effort_for(campaign: Campaign, budget_s: float) -> Effort:
    """What fits into `budget_s` seconds of two cores by the rig's rated speed; the same on every machine."""
    seconds = [run.motion_s(1) for run in campaign.runs]
    rated = campaign.runs[0].twin.model.speed

    def planned(seconds: float) -> tuple[int, int]:
        motions = min(_SIMULATING * budget_s * _CORES * rated / seconds, _A_SECOND * budget_s)
        motions = int(min(max(motions, _LEAST_MOTIONS), _MOST_MOTIONS))
        judge = max(36, motions // 6)
        return motions - judge, judge

    (search, judge), (of_longest, _) = planned(sum(seconds)), planned(max(seconds))
    return Effort(search, judge, FEWEST * len(doubts_of(campaign)), of_longest)


def diagnose(
    subject: Subject,
    measured: Blocks,
    effort: Effort,
    execute: Execute,
    seed: int,
    told: Sequence[float] = (),
) -> Findings:
    """Diagnose `measured` fingerprints, shape (blocks, numbers); `execute` simulates.

    `told`: how many blocks of each run they are worth, where one stands in several rows; empty: as many as
    there are rows.

    Where gaps are judged on one half of the blocks, parameters were fitted to the other; in the answer they
    are fitted to all.
    """
    rng = np.random.default_rng(seed)
    library, searching, judging = Library(), _Counted(execute), _Counted(execute)
    search = Search(
        subject, measured, searching, rng, library, effort.search, told, of_longest=effort.of_longest
    )
    attribution, ranked = search.until_one_leads()
    measure = gap_measure(library.fingerprints(()), subject.layout)
    explaining = Explaining(search, attribution, measure, effort.about, judging, rng)
    explaining, ranked, at_first = _looked_at(explaining, ranked, searching)
    attribution, searched = explaining.attribution, searching.share
    explanation = explaining.completed(at_first)
    known = search.bring_back([(cause,) for cause in explanation.best.hypothesis])
    if known or explanation.best.hypothesis != ranked[0].hypothesis:  # values may have been doubted meanwhile
        attribution = search.learn()
    if any((cause,) not in attribution.emulators for cause in explanation.best.hypothesis):
        explanation = at_first  # there was no time to bring back what would be beside it
    ranked = explaining.believed(ranked, explanation)
    focus, left = explanation.focus, explanation.left
    belief = belief_of(attribution, ranked, left, searched)
    fitted_to, judged_on = halves(measured)
    candidates = candidates_of(ranked, search, attribution)
    fits = refitted(candidates, attribution, fitted_to, rng)
    if focus is not None:
        worth = attribution.moments.worth(told, len(measured)) * len(fitted_to) / len(measured)
        fits[focus.hypothesis] = replace(ranked[0], posterior=focus.posterior(fitted_to, worth, rng))
    repaired = _repaired(fits, focus, effort.judge // _CONFIRMING, judging, rng)
    chosen, twins, belief = _chosen(candidates, attribution, repaired, belief, measure, judged_on)
    distances = separability(attribution, ranked, rng)
    selected, put_in = (chosen.hypothesis, named(chosen.hypothesis, chosen.best())) if chosen else ((), ())
    moved = None if twins is None else moved_by(fits[selected], focus, library, rng, searched)
    gap = gap_between(measure, judged_on, measured, twins, rng, chosen is not None, moved)
    runner_up = _runner_up(candidates, repaired, selected)
    rival = () if runner_up is None else contrasts(measure, judged_on, twins, repaired[runner_up])
    judged = _judged(measure, judged_on, ranked, repaired, belief, chosen, gap.after)
    off = alone_off((measure, measure.of_repaired(explanation.like)), measured)
    return Findings(
        layout=subject.layout,
        none=belief.none,
        effect=belief.effect,
        unknown=belief.unknown,
        judged=tuple(inseparable(judged, distances)),
        selected=selected,
        effects=tuple(each for cause, each in zip(selected, put_in, strict=True) if not cause.entered),
        put_in=put_in,
        gap=gap,
        by_location=_by_location(search, attribution, ranked, belief.unexplained, chosen),
        alone_off=off,
        entered=_entered(ranked, belief),
        not_fitting=not_fitting(subject.layout, measured, explanation.like),
        separability=distances,
        measured=np.mean(measured, axis=0, dtype=np.float64),
        nominal=measure.twin,
        repaired=None if twins is None else twins.mean(axis=0),
        floor=measure.floor,
        held_out=len(measured) > 1,
        simulations=searching.observations + judging.observations,
        left=left,
        runner_up=None if runner_up is None else (runner_up, repaired[runner_up].mean(axis=0)),
        contrasts=rival,
        alone=alone(search, tuple(fits), selected or next(iter(fits), ()), searched),
        searched=searched,
        judging=judging.share,
    )


@dataclass(slots=True)
class _Counted:
    """Counts what it was asked for, what there was time for, and what was observed of it."""

    execute: Execute
    asked: int = 0
    done: int = 0
    observations: int = 0

    @property
    def share(self) -> float:
        """Of what it was asked for, that there was time for."""
        return self.done / self.asked if self.asked else 1.0

    def __call__(self, draws: Sequence[Draw]) -> Sequence[Observed]:
        shown = self.execute(draws)
        self.asked += len(shown)
        self.done += sum(bool(each) for each in shown)
        self.observations += sum(one is not None for each in shown for one in each)
        return shown


def _looked_at(
    explaining: Explaining, ranked: Sequence[Ranked], searching: _Counted
) -> tuple[Explaining, list[Ranked], Explanation]:
    """What leads, by rigs about it; where these leave it open, what leads once the search has gone on."""
    believed = of_a_part(ranked, searching.share)
    found, search = explaining.explained(believed[0]), explaining.search
    if not (search.may_go_on and explaining.leaves_open(found)):
        return explaining, believed, found
    attribution, ranked = search.go_on()
    explaining, believed = replace(explaining, attribution=attribution), of_a_part(ranked, searching.share)
    return explaining, believed, explaining.explained(believed[0])


def _runner_up(
    candidates: Sequence[Ranked], repaired: Mapping[Hypothesis, Array], selected: Hypothesis
) -> Hypothesis | None:
    """The best that was judged and has nothing of what was selected; where each has, the best other one."""
    others = [h for h in (each.hypothesis for each in candidates) if h in repaired and h != selected]
    taken = {cause.name for cause in selected}
    apart = [h for h in others if taken.isdisjoint(cause.name for cause in h)]
    return next(iter(apart or others), None)


def _chosen(
    candidates: Sequence[Ranked],
    attribution: Attribution,
    repaired: Mapping[Hypothesis, Array],
    belief: Belief,
    measure: GapMeasure,
    judged_on: Blocks,
) -> tuple[Ranked | None, Array | None, Belief]:
    """What is selected, if anything, rigs with it (n, numbers), and what is believed once it was judged."""
    if belief.verdict != "effect" or not candidates:
        return None, None, belief
    found = candidates[0]
    chosen = without_idle_partners(found, candidates, repaired, measure, judged_on)
    names, kept = ({cause.name for cause in each.hypothesis} for each in (found, chosen))
    most = largest(attribution, chosen.hypothesis, chosen.best())
    belief, twins = belief.without(names - kept, most), repaired.get(chosen.hypothesis)
    if twins is not None and leads_away(measure, judged_on, twins):
        return None, None, belief.refuted()
    return chosen, twins, belief


def candidates_of(ranked: Sequence[Ranked], search: Search, attribution: Attribution) -> list[Ranked]:
    """The most probable explanations with an effect, of those that no run alone ruled out.

    With them the first without each one of its causes, so that each has to earn its place.
    """
    known, effects = attribution.emulators, (each for each in ranked if effects_of(each.hypothesis))
    best = [each for each in effects if all((one,) in known for one in each.hypothesis)][:_JUDGED]
    found = best[0].hypothesis if best else ()
    less = [tuple(cause for cause in found if cause is not one) for one in found]
    there = {each.hypothesis for each in best}
    fewer = [each for each in less if effects_of(each) and each not in there]
    weighed = search.weigh(attribution, fewer)
    return [*best, *(Ranked(each.hypothesis, 0.0, each.posterior, each.misfit) for each in weighed)]


def _repaired(
    fits: Mapping[Hypothesis, Ranked],
    focus: Focus | None,
    motions: int,
    execute: Execute,
    rng: np.random.Generator,
) -> dict[Hypothesis, Array]:
    """Fingerprints (n, numbers) of rigs with each hypothesis in, as it fits: those of `focus` are there."""
    known = {} if focus is None else {focus.hypothesis: focus.rigs_at(fits[focus.hypothesis].best())}
    others = {hypothesis: fit for hypothesis, fit in fits.items() if hypothesis not in known}
    return known | repaired_twins(others, motions, execute, rng)


def _judged(
    measure: GapMeasure,
    judged_on: Blocks,
    ranked: Sequence[Ranked],
    repaired: Mapping[Hypothesis, Array],
    belief: Belief,
    chosen: Ranked | None,
    left: float | None,
) -> list[Judged]:
    """Every effect once, on its most probable channel, as the most probable hypothesis with it says.

    The gaps after it are with it alone. Those of `chosen` are as it says; where it leaves more of the gap
    than 1, `left`, their intervals are wider by as much, since its model holds no better than that.
    """
    before = measure.total(measure.cells(judged_on))
    found: dict[str, Judged] = {}
    for each in ranked:
        if not is_effect(each.hypothesis) or each.hypothesis[0].name in found:
            continue
        twins = repaired.get(each.hypothesis)
        after = None if twins is None else gap_after(measure, judged_on, twins)
        name = each.hypothesis[0].name
        is_chosen = chosen is not None and any(one.name == name for one in chosen.hypothesis)
        with_it = (one for one in ranked if any(cause.name == name for cause in one.hypothesis))
        told_by = chosen if chosen is not None and is_chosen else next(with_it)
        at = next(k for k, one in enumerate(told_by.hypothesis) if one.name == name)
        cause, wider = told_by.hypothesis[at], max(1.0, left or 1.0) if is_chosen else 1.0
        of_cause = told_by.estimates()[parts_of(told_by.hypothesis)[at]]
        found[name] = Judged(
            cause,
            belief.of_effects.get(name, 0.0),
            {
                parameter.name: one.widened(wider, parameter.intervals[0][0], parameter.intervals[-1][1])
                for parameter, one in zip(cause.parameters, of_cause, strict=True)
            },
            named(told_by.hypothesis, told_by.best())[at],
            after,
            None if after is None else shrink_of(before, after),
            present=belief.present.get(name, 0.0),
        )
    return sorted(found.values(), key=lambda each: -each.probability)


def _entered(ranked: Sequence[Ranked], belief: Belief) -> tuple[Entered, ...]:
    """Values that may have been entered wrongly, each as the most probable hypothesis with it says."""
    found: dict[str, Entered] = {}
    for each in ranked:
        for cause, at in zip(each.hypothesis, parts_of(each.hypothesis), strict=True):
            if cause.entered and cause.name not in found:
                share = belief.entered.get(cause.name, 0.0)
                found[cause.name] = Entered(cause, share, each.estimates()[at][0])
    return tuple(sorted(found.values(), key=lambda one: -one.probability))


def _by_location(
    search: Search,
    attribution: Attribution,
    ranked: Sequence[Ranked],
    unknown: float,
    chosen: Ranked | None,
) -> dict[str, float]:
    """Shares of the locations in what is believed to explain it, and in what is `unknown` beside `chosen`."""
    believed = (cause for each in ranked for cause in each.hypothesis)
    shares = {cause.location: 0.0 for cause in (*search.causes, *believed)}
    for each in ranked:
        for cause, share in contributions(attribution, each.hypothesis, each.best()).items():
            shares[cause.location] += each.probability * share
    total = sum(shares.values()) or 1.0
    shares = {location: (1 - unknown) * share / total for location, share in shares.items()}
    explained = attribution.response(chosen.hypothesis, chosen.best()[None])[0][0] if chosen else np.zeros(1)
    at = where_unknown(attribution, search.measured, explained, search.causes, search.library)
    for location, share in at.items():
        shares[location] = shares.get(location, 0.0) + unknown * share
    return dict(sorted(shares.items(), key=lambda one: -one[1]))
