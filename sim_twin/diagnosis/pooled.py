"""Several diagnoses of the same measurement, each with rigs of another seed, as one answer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_twin.diagnosis.belief import verdict_of
from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.posterior import Estimate


def pooled(each: Sequence[Findings]) -> Findings:
    """Means of the probabilities; all else is of the first that says what the means and most of them say.

    An interval holds the medians of all that selected the same effect, and the interval of the one shown.
    """
    if len(each) == 1:
        return each[0]
    none, effect, unknown = (
        float(np.mean([getattr(one, what) for one in each])) for what in ("none", "effect", "unknown")
    )
    verdict = verdict_of(none, effect, unknown)
    saying = [one for one in each if one.verdict == verdict] or list(each)
    usual = Counter(one.names for one in saying).most_common(1)[0][0]
    shown = next(one for one in saying if one.names == usual)
    judged = sorted((_judged(one, each) for one in shown.judged), key=lambda one: -one.probability)
    simulations = sum(one.simulations for one in each)
    return replace(
        shown,
        none=none,
        effect=effect,
        unknown=unknown,
        judged=tuple(judged),
        simulations=simulations,
    )


def _judged(shown: Judged, each: Sequence[Findings]) -> Judged:
    same = [one for findings in each for one in findings.judged if one.cause.name == shown.cause.name]
    chosen = [
        one
        for findings in each
        for one in findings.judged
        if one.cause == shown.cause and shown.cause.name in findings.names
    ]
    parameters = {
        name: Estimate(
            found.value,
            min([found.low, *(one.parameters[name].value for one in chosen)]),
            max([found.high, *(one.parameters[name].value for one in chosen)]),
        )
        for name, found in shown.parameters.items()
    }
    probability, present = np.mean([[one.probability, one.present] for one in same], axis=0).tolist()
    return replace(shown, probability=probability, present=present, parameters=parameters)
