"""What one reads in a minute: the verdict in two sentences, the numbers that matter, what was lost."""

from __future__ import annotations

from rig.diagnosis.report.case import (
    Case,
    floors,
    identified,
    parameter_words,
    plain,
    plausible,
    what_and_where,
)
from rig.pages.content import BigNumber, BigNumbers, Lead, Part, Sentence
from rig.pages.words import DASH, estimate, listed, probability, span
from sim_twin.diagnosis.findings import Entered, Gap, Judged

_OWN_UNIT = (
    "A gap of 1.0 is as far as a healthy rig lies from the twin, as the subject draws healthy rigs, with the "
    "same amount of data."
)
_UNIT = (
    "A gap of 1.0 is as far as a healthy rig of the same scenario lies from the twin, with its tolerances, "
    "its noise and the same amount of data. It compares distributions over the cycles, never waveforms."
)
_VERDICTS = {"effect": "effect", "none": "nothing missing", "unknown": "unknown"}
_SURE, _LIKELY = 0.9, 0.6
_MAY_BE = 0.2
"""Probability from which on a value that may be wrong is named."""
LEFT_OPEN = 1.5
"""A gap that is left from which on the repaired twin is not the rig."""

_LEFT = (
    "What is left is more than a healthy rig's: the parameters are those of the nearest twin that was found "
    "(their intervals are wider by as much); a longer search may find a nearer one."
)


def parts(case: Case) -> list[Part]:
    """Two sentences, the numbers that matter, and what was lost of the recordings."""
    lost = [Sentence(remark, warning=True) for remark in case.remarks]
    found, gap = case.findings, case.findings.gap
    sure = {"effect": found.effect, "none": found.none, "unknown": found.unknown}[found.verdict]
    numbers = [
        BigNumber("Verdict", _VERDICTS[found.verdict], f"probability {probability(sure)}"),
        BigNumber("Gap before", floors(gap.before), "nominal twin; 1.0 = healthy"),
    ]
    if case.repaired:
        within = listed([plain(cause.name) for cause in found.selected])
        shrink, remark = DASH, "no gap to shrink"
        if gap.shrink is not None:
            shrink, remark = f"{100 * gap.shrink:.0f} %", interval(gap)
        numbers.append(BigNumber("Gap after", floors(gap.after), f"with {within}"))
        numbers.append(BigNumber("Shrink", shrink, remark))
    horizon = case.diagnosis.get("horizon_s")
    if horizon is not None:
        numbers.append(BigNumber("Horizon", estimate(horizon, "s"), "no waveform holds longer"))
    return [Lead(sentences(case)), *lost, BigNumbers(numbers), Sentence(_OWN_UNIT if case.subject else _UNIT)]


def sentences(case: Case) -> tuple[str, str]:
    """What, where, how sure; then how far the gap shrinks, where the rest lies, or what could have hidden."""
    return {"effect": _effect, "none": _none, "unknown": _unknown}[case.findings.verdict](case)


def _effect(case: Case) -> tuple[str, str]:
    selected = case.selected
    if not selected:
        return "An effect of the catalogue is behind the gap, but none stands out.", _where(case)
    likely = selected[0].probability
    comes = "comes" if likely >= _SURE else "probably comes" if likely >= _LIKELY else "may come"
    if len(selected) == 1:
        return f"The gap {comes} from {_single(case, selected[0])}.", _shrinks(case, 1)
    causes = listed([what_and_where(each.cause) for each in selected])
    larger = f"{plain(selected[0].cause.name)} is the larger (probability {probability(likely)})"
    present = listed([probability(each.present) for each in selected])
    text = f"The gap {comes} from {causes} together, in the rig with a probability of {present}; {larger}."
    return text, _shrinks(case, len(selected))


def _single(case: Case, one: Judged) -> str:
    sure = f"{what_and_where(one.cause)} (probability {probability(one.probability)})"
    by_name = {each.cause.name: each for each in case.findings.judged}
    others = [by_name[name] for name in one.indistinguishable_from if name in by_name]
    alike = [f"{what_and_where(each.cause)} ({probability(each.probability)})" for each in others]
    if alike:
        return f"{listed([sure, *alike], 'or from')}, which these sensors and settings cannot tell apart"
    if not one.cause.parameters:
        return sure
    parameter = one.cause.parameters[0]
    found, unit = one.parameters[parameter.name], parameter.unit
    if not identified(parameter, found):
        anything = f"anything from {span(found.low, found.high, unit)} of {plausible(parameter)} fits as well"
        return f"{sure}: {parameter_words(parameter)} is not identified, {anything}"
    value = f"{parameter_words(parameter)} {estimate(found.value, unit)}"
    return f"{sure}: {value}, 95 % interval {span(found.low, found.high, unit)}"


def _shrinks(case: Case, count: int) -> str:
    gap = case.findings.gap
    if not case.repaired:
        return (
            f"The gap is {floors(gap.before)}, where 1.0 is a healthy rig; how far it shrinks is not known, "
            "for there was no time to simulate the repaired twin: give it more --budget, or an idle machine."
        )
    within = "With it" if count == 1 else "With both" if count == 2 else "With all of them"
    if others := [plain(cause.name) for cause in case.findings.selected if cause.entered]:
        within += f", and with {listed(others)} as it fits,"
    if gap.shrink is None:
        return (
            f"The gap is {floors(gap.before)}, no larger than a healthy rig's (1.0); "
            f"{within[0].lower()}{within[1:]} in the twin {floors(gap.after)} is left."
        )
    between = f", {interval(gap)}" if interval(gap) else ""
    told = (
        f"{within} in the twin the gap falls from {floors(gap.before)} to {floors(gap.after)}, where 1.0 is "
        f"a healthy rig: {100 * gap.shrink:.0f} % of it is gone{between}."
    )
    return told if gap.after is None or gap.after < LEFT_OPEN else f"{told} {_LEFT}"


def interval(gap: Gap) -> str:
    """The shrink's interval in words; nothing where it has none, or none to be seen."""
    if gap.shrink_ci95 is None:
        return ""
    low, high = (f"{100 * end:.0f}" for end in gap.shrink_ci95)
    return "" if low == high else f"95 % interval {low} to {high} %"


def _none(case: Case) -> tuple[str, str]:
    gap = case.findings.gap
    runs = "run" if len(case.run_numbers) == 1 else "runs"
    first = (
        f"Nothing is missing: the twin explains the {runs} (probability {probability(case.findings.none)}), "
        f"with a gap of {floors(gap.before)} where 1.0 is a healthy rig."
    )
    if not case.judged:
        return first, "No effect of the catalogue was tried."
    hardest = case.judged[0]
    second = (
        f"Of the catalogue's {len(case.judged)} effects, {what_and_where(hardest.cause)} is the hardest "
        f"to rule out ({probability(hardest.probability)})"
    )
    if hardest.cause.parameters:
        parameter = hardest.cause.parameters[0]
        found = hardest.parameters[parameter.name]
        hidden = span(found.low, found.high, parameter.unit)
        second += f"; it could hide with {parameter_words(parameter)} from {hidden}"
    return first, f"{second}."


def _unknown(case: Case) -> tuple[str, str]:
    first = (
        "Something that no effect of the catalogue explains is in the rig "
        f"(probability {probability(case.findings.unknown)})"
    )
    if case.judged:
        nearest = case.judged[0]
        first += f"; the nearest, {what_and_where(nearest.cause)}, has {probability(nearest.probability)}"
    entered = case.findings.entered[:1]
    if entered and entered[0].probability >= _MAY_BE:
        first += f". It may be that {_wrong(entered[0])}"
    return f"{first}.", _where(case)


def _wrong(entered: Entered) -> str:
    [parameter], found = entered.cause.parameters, entered.estimate
    return (
        f"{plain(entered.cause.name)} is wrong (probability {probability(entered.probability)}): "
        f"{estimate(found.value, parameter.unit)} fits, "
        f"95 % interval {span(found.low, found.high, parameter.unit)}"
    )


def _where(case: Case) -> str:
    channel, run, size = case.largest_channels()[0]
    band = case.largest_span(channel, run, lambda cell: cell.band)
    phase = case.largest_span(channel, run, lambda cell: cell.phase)
    spots = [f"at {band[0]:.0f} to {band[1]:.0f} Hz"] if band else []
    spots += [f"from {phase[0]:.2f} to {phase[1]:.2f} of the cycle"] if phase else []
    most = f", most {listed(spots)}" if spots else ", much the same all over it"
    return (
        f"The gap is {floors(case.findings.gap.before)}, where 1.0 is a healthy rig, "
        f"and largest in {channel} ({floors(size)}){most}."
    )
