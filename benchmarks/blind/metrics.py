"""What is counted, case by case; a diagnosis that failed counts as wrong wherever it could be right."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.cases import NONE, UNKNOWN, Answer, Case, Ranked
from benchmarks.blind.catalogue import CATALOGUE, main_parameter

_ALARM = 0.5
_BINS = 10
_PLAYS = 300
NOT_KNOWN = "not known"


def first_answer(answer: Answer) -> str:
    """The most probable of all effects, "none" and "unknown"."""
    return answer.ranking()[0][0]


def first_right(case: Case) -> float:
    """1 if the first answer is the truth; 1/n where it is in the set of n that the first answer names."""
    if case.answer is None:
        return 0.0
    named = case.answer.named_by(first_answer(case.answer))
    return 1 / len(named) if case.truth & named else 0.0


def three_right(case: Case) -> float:
    """1 if the truth is one of the first three answers; 1/n if only a set of n named there has it."""
    if case.answer is None:
        return 0.0
    first = [name for name, _ in case.answer.ranking()[:3]]
    return 1.0 if case.truth & set(first) else _by_set(case, first)


def three_right_by_set(case: Case) -> float:
    """Like `three_right`, but a set of n counts 1/n even where the truth is among the three by name."""
    if case.answer is None:
        return 0.0
    return _by_set(case, [name for name, _ in case.answer.ranking()[:3]])


def first_effect_right(case: Case) -> float:
    """1 if the truth is the most probable effect, whatever "none" and "unknown" are given."""
    answer = case.answer
    return float(answer is not None and bool(answer.effects) and most_probable(answer).name in case.truth)


def _by_set(case: Case, first: Sequence[str]) -> float:
    answer = case.answer
    if answer is None:
        return 0.0
    sets = [answer.named_by(name) for name in first]
    return max((1 / len(named) for named in sets if case.truth & named), default=0.0)


def most_probable(answer: Answer) -> Ranked:
    """The effect at the head of the list."""
    return max(answer.effects, key=lambda effect: effect.probability)


def truth_probability(case: Case) -> float:
    """The probability that the answer gives the truth."""
    return 0.0 if case.answer is None else sum(case.answer.probability(label) for label in case.truth)


def brier(case: Case) -> float:
    """Squared distance between the probabilities and the truth (one effect, "none" or "unknown"), 0 to 2."""
    if case.answer is None:
        return 2.0
    return sum((p - (label in case.truth)) ** 2 for label, p in case.answer.ranking())


def calibration_error(cases: Sequence[Case]) -> float:
    """Expected calibration error of the first answer's probability in ten bins of equal number.

    Where the runs cannot show what is hidden, "none" is right too.
    """
    said, right = _said_and_right(cases)
    return _binned_error(said, right)


def calibrated_error(cases: Sequence[Case]) -> float:
    """What `calibration_error` is on average where answers are right as often as they say; bins are small."""
    said, _ = _said_and_right(cases)
    rng = np.random.default_rng(0)
    played = [_binned_error(said, (rng.random(len(said)) < said).astype(float)) for _ in range(_PLAYS)]
    return float(np.mean(played))


def _said_and_right(cases: Sequence[Case]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    pairs = np.array([confidence(case) for case in cases]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _binned_error(said: NDArray[np.float64], right: NDArray[np.float64]) -> float:
    if not len(said):
        return math.nan
    bins = [each for each in np.array_split(np.argsort(said, kind="stable"), _BINS) if len(each)]
    return float(sum(abs(said[each].sum() - right[each].sum()) for each in bins) / len(said))


def confidence(case: Case) -> tuple[float, float]:
    """Probability of the first answer, and 1 if it is right; a failed diagnosis was sure, and wrong."""
    if case.answer is None:
        return 1.0, 0.0
    label, probability = case.answer.ranking()[0]
    right = case.truth if case.visible else case.truth | {NONE}
    return probability, float(label in right)


def false_alarm(case: Case) -> float:
    """1 if effects are given more than a half, one of them or all together."""
    if case.answer is None:
        return 1.0
    return float(sum(effect.probability for effect in case.answer.effects) > _ALARM)


def not_none(case: Case) -> float:
    """1 if the first answer is not "none"."""
    return float(case.answer is None or first_answer(case.answer) != NONE)


def location_right(case: Case) -> float:
    """1 if the first answer lies where the hidden effect does; "none" and "unknown" lie nowhere."""
    if case.answer is None:
        return 0.0
    catalogue = CATALOGUE[case.campaign.rig]
    said = {each.name: each.location for each in case.answer.effects}.get(first_answer(case.answer))
    return float(said in {catalogue[name].location for name in case.hidden})


def place_right(case: Case) -> float:
    """1 if the answer has most of the gap come from where something of no catalogue sits."""
    return float(case.answer is not None and case.answer.place in case.campaign.places)


def place_told(case: Case) -> float:
    """1 if the answer has most of the gap come from anywhere at all."""
    return float(case.answer is not None and case.answer.place not in ("", NOT_KNOWN))


def failed(case: Case) -> float:
    """1 if there is no answer: refused, stopped or in error."""
    return float(case.answer is None)


def unknown_first(case: Case) -> float:
    """1 if the first answer is "unknown"."""
    return float(case.answer is not None and first_answer(case.answer) == UNKNOWN)


def channel_right(case: Case) -> float | None:
    """Whether the channel of a rightly named effect is right; None where the effect has none."""
    effect = _rightly_named(case)
    truth = _parameters(case).get("channel")
    if effect is None or truth is None:
        return None
    return float("channel" in effect.parameters and effect.parameters["channel"].value == truth)


def parameter_error(case: Case) -> float:
    """Relative error of the main parameter of a single effect.

    Infinite where something else was named, on the wrong channel and without an answer.
    """
    effect = _rightly_named(case)
    if effect is None:
        return math.inf
    name, truth = _main(case)
    value = effect.parameters[name].value if name in effect.parameters else None
    if not isinstance(value, int | float) or channel_right(case) == 0:
        return math.inf
    return abs(value - truth) / abs(truth)


def parameter_covered(case: Case) -> float:
    """1 if the 95 % interval of that parameter holds the truth; 0 where the error is infinite."""
    effect = _rightly_named(case)
    if effect is None:
        return 0.0
    name, truth = _main(case)
    interval = effect.parameters[name].interval if name in effect.parameters else None
    if interval is None or channel_right(case) == 0:
        return 0.0
    return float(interval[0] <= truth <= interval[1])


def _rightly_named(case: Case) -> Ranked | None:
    if case.answer is None or len(case.hidden) != 1 or first_answer(case.answer) != case.hidden[0]:
        return None
    return next(effect for effect in case.answer.effects if effect.name == case.hidden[0])


def _parameters(case: Case) -> dict[str, float | str]:
    parameters = case.campaign.effects[0]["parameters"]
    assert isinstance(parameters, dict)
    return parameters


def _main(case: Case) -> tuple[str, float]:
    parameters = _parameters(case)
    name = main_parameter(case.hidden[0], parameters)
    return name, float(parameters[name])


def selected_f1(cases: Sequence[Case]) -> float:
    """Micro-F1 of `selected` against the hidden effects."""
    hit = named = hidden = 0
    for case in cases:
        selected = set() if case.answer is None else set(case.answer.selected)
        hit += len(selected & set(case.hidden))
        named += len(selected)
        hidden += len(set(case.hidden))
    return 2 * hit / (named + hidden) if named + hidden else math.nan


def exact_set(case: Case) -> float:
    """1 if `selected` is just what is hidden."""
    return float(case.answer is not None and set(case.answer.selected) == set(case.hidden))


def unknown_score(case: Case) -> float:
    """What is given to "unknown"; a failed diagnosis ranks as wrong as it can."""
    if case.answer is not None:
        return case.answer.unknown
    return -1.0 if UNKNOWN in case.truth else 2.0


def auroc(cases: Sequence[Case]) -> float:
    """Chance that a case outside the catalogue is given more "unknown" than another; ties count a half."""
    score = np.array([unknown_score(case) for case in cases])
    outside = np.array([UNKNOWN in case.truth for case in cases])
    return _area(score[outside], score[~outside])


def above(case: Case) -> float | None:
    """Whether it is above the thresholds that were set without its class."""
    return case.above


def outranks(case: Case) -> float | None:
    """Share of the others below it, by scores that were fitted without its class; the mean is an AUROC."""
    return case.outranks


def _area(positive: NDArray[np.float64], negative: NDArray[np.float64]) -> float:
    if not len(positive) or not len(negative):
        return math.nan
    return float(np.mean([share_below(score, negative) for score in positive]))


def share_below(score: float, others: NDArray[np.float64]) -> float:
    """Share of `others` that are below `score`; those as high count a half."""
    return float(np.mean(others < score) + np.mean(others == score) / 2)


def gap_after(case: Case) -> float | None:
    """Gap to the twin with the answer's effects in; None where it was not measured."""
    return None if case.gaps is None else case.gaps.after


def relative_shrink(case: Case) -> float | None:
    """The answer's shrink of the gap relative to the true effects'; None where it was not measured."""
    return None if case.gaps is None else case.gaps.relative_shrink


def wall(case: Case) -> float | None:
    """Wall time of the diagnosis, s."""
    return case.wall_s


def processor(case: Case) -> float | None:
    """Processor time of the diagnosis, s."""
    return case.cpu_s


def memory(case: Case) -> float | None:
    """Most memory of all its processes together, MB."""
    return case.memory_mb
