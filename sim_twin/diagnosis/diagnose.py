"""The way of a diagnosis: search, judge on data that were not fitted, weigh, select."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.belief import Belief, belief_of, contributions
from sim_twin.diagnosis.cause import Cause, Hypothesis, named, parts_of
from sim_twin.diagnosis.effort import Effort
from sim_twin.diagnosis.estimate import Estimate
from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.gap import GapMeasure, gap_measure, shrink_of
from sim_twin.diagnosis.judging import gap_between, halves, repaired_twins
from sim_twin.diagnosis.library import Library
from sim_twin.diagnosis.search import Ranked, Search
from sim_twin.diagnosis.separability import inseparable, separability
from sim_twin.diagnosis.subject import Execute, Subject

Array = NDArray[np.float64]
Blocks = NDArray[np.float32]
_JUDGED = 4


def diagnose(subject: Subject, measured: Blocks, effort: Effort, execute: Execute, seed: int) -> Findings:
    """Diagnose `measured` fingerprints, shape (blocks, numbers); `execute` simulates.

    Where gaps are judged on one half of the blocks, parameters were fitted to the other; in the answer they
    are fitted to all.
    """
    rng = np.random.default_rng(seed)
    library = Library()
    attribution, ranked = Search(subject, measured, execute, rng, library, effort.search).run()
    fitted_to, judged_on = halves(measured)
    candidates = [each for each in ranked if each.hypothesis][:_JUDGED]
    repaired = repaired_twins(candidates, attribution, fitted_to, effort.judge, execute, rng)
    belief = belief_of(attribution, library, ranked, measured)
    chosen = candidates[0] if belief.verdict == "effect" and candidates else None
    measure = gap_measure(library.fingerprints(()), subject.layout)
    twins = repaired.get(chosen.hypothesis) if chosen else None
    distances = separability(attribution, ranked, rng)
    judged = _judged(measure, judged_on, ranked, repaired, belief)
    return Findings(
        layout=subject.layout,
        none=belief.none,
        effect=belief.effect,
        unknown=belief.unknown,
        judged=tuple(inseparable(judged, distances)),
        selected=chosen.hypothesis if chosen else (),
        effects=named(chosen.hypothesis, chosen.best()) if chosen else (),
        gap=gap_between(measure, judged_on, measured, twins, rng, selected=chosen is not None),
        by_location=_by_location(subject, ranked, attribution),
        separability=distances,
        measured=np.mean(measured, axis=0, dtype=np.float64),
        nominal=measure.twin,
        repaired=None if twins is None else twins.mean(axis=0),
        floor=measure.floor,
        held_out=len(measured) > 1,
        simulations=library.observations + sum(len(each) for each in repaired.values()),
        misfit=belief.misfit,
    )


def _judged(
    measure: GapMeasure,
    judged_on: Blocks,
    ranked: Sequence[Ranked],
    repaired: Mapping[Hypothesis, Array],
    belief: Belief,
) -> list[Judged]:
    """Every effect once, alone on its most probable channel."""
    before = measure.total(measure.cells(judged_on))
    found: dict[str, Judged] = {}
    for each in ranked:
        if len(each.hypothesis) != 1 or each.hypothesis[0].name in found:
            continue
        twins, after = repaired.get(each.hypothesis), None
        if twins is not None:
            mended = measure.of_repaired(twins)
            after = mended.total(mended.cells(judged_on))
        cause, name = each.hypothesis[0], each.hypothesis[0].name
        told_by = _most_probable_with(name, ranked)
        cause = next(one for one in told_by.hypothesis if one.name == name)
        share = belief.of_effects.get(name, 0.0)
        found[name] = Judged(
            cause,
            share,
            _estimates(told_by, cause),
            after,
            None if after is None else shrink_of(before, after),
        )
    return sorted(found.values(), key=lambda each: -each.probability)


def _most_probable_with(name: str, ranked: Sequence[Ranked]) -> Ranked:
    return next(each for each in ranked if any(cause.name == name for cause in each.hypothesis))


def _estimates(ranked: Ranked, cause: Cause) -> dict[str, Estimate]:
    at = parts_of(ranked.hypothesis)[ranked.hypothesis.index(cause)]
    return {p.name: estimate for p, estimate in zip(cause.parameters, ranked.estimates()[at], strict=True)}


def _by_location(subject: Subject, ranked: Sequence[Ranked], attribution: Attribution) -> dict[str, float]:
    """Shares of the locations in what the believed hypotheses explain."""
    shares = {cause.location: 0.0 for cause in subject.causes}
    for each in ranked:
        for cause, share in contributions(attribution, each.hypothesis, each.best()).items():
            shares[cause.location] += each.probability * share
    total = sum(shares.values()) or 1.0
    return {location: share / total for location, share in sorted(shares.items(), key=lambda one: -one[1])}
