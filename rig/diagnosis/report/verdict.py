"""The verdict in two sentences."""

from __future__ import annotations

from rig.diagnosis.report import gaps
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.words import (
    estimate,
    floors,
    listed,
    parameter_words,
    percent,
    plain,
    span,
    what_and_where,
)
from sim_twin.diagnosis.findings import Gap, Judged

_SURE, _LIKELY = 0.9, 0.6
_LEFT_OPEN = 1.5
"""A gap that is left from which on the repaired twin is not the rig."""


def sentences(reported: Reported) -> tuple[str, str]:
    """What, where, how sure; then how far the gap shrinks, where the rest lies, or what could have hidden."""
    return {"effect": _effect, "none": _none, "unknown": _unknown}[reported.verdict](reported)


def _effect(reported: Reported) -> tuple[str, str]:
    selected = _selected(reported)
    if not selected:
        return "An effect of the catalogue is behind the gap, but none stands out.", _where(reported)
    likely = selected[0].probability
    comes = "comes" if likely >= _SURE else "probably comes" if likely >= _LIKELY else "may come"
    what = _pair(selected) if len(selected) > 1 else _single(reported, selected[0])
    return f"The gap {comes} from {what}.", _shrinks(reported, len(selected))


def _selected(reported: Reported) -> list[Judged]:
    """What the repaired twin has in, most probable first."""
    names = {cause.name for cause in reported.findings.selected}
    return [each for each in reported.judged if each.cause.name in names]


def _single(reported: Reported, one: Judged) -> str:
    sure = f"{what_and_where(one.cause)} (probability {percent(one.probability)})"
    others = [reported.judged_of(name) for name in one.indistinguishable_from]
    alike = [f"{what_and_where(each.cause)} ({percent(each.probability)})" for each in others if each]
    if not alike:
        return f"{sure}{_main(one)}"
    return f"{listed([sure, *alike], 'or from')}, which these sensors and settings cannot tell apart"


def _main(one: Judged) -> str:
    if not one.cause.parameters:
        return ""
    parameter = one.cause.parameters[0]
    return f": {parameter_words(parameter)} {estimate(one.parameters[parameter.name], parameter.unit)}"


def _pair(selected: list[Judged]) -> str:
    causes = listed([what_and_where(each.cause) for each in selected])
    first = selected[0]
    larger = f"{plain(first.cause.name)} is the larger (probability {percent(first.probability)})"
    return f"{causes} together; {larger}"


def _shrinks(reported: Reported, count: int) -> str:
    gap = reported.findings.gap
    if not reported.repaired:
        return (
            f"The gap is {floors(gap.before)}, where 1.0 is a healthy rig; how far it shrinks is not known, "
            "for there was no time to simulate the repaired twin: give it more --budget, or an idle machine."
        )
    within = "With it" if count == 1 else "With both" if count == 2 else "With all of them"
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
    return told if gap.after is None or gap.after < _LEFT_OPEN else f"{told} {_LEFT}"


_LEFT = (
    "What is left is more than a healthy rig's: the parameters are those of the nearest twin that was found "
    "(their intervals are wider by as much); more --budget may find a nearer one."
)


def interval(gap: Gap) -> str:
    """The shrink's interval in words; nothing where it has none, or none to be seen."""
    if gap.shrink_ci95 is None:
        return ""
    low, high = (f"{100 * end:.0f}" for end in gap.shrink_ci95)
    return "" if low == high else f"95 % interval {low} to {high} %"


def _none(reported: Reported) -> tuple[str, str]:
    gap = reported.findings.gap
    runs = "run" if len(gaps.runs(reported)) == 1 else "runs"
    first = (
        f"Nothing is missing: the twin explains the {runs} (probability {percent(reported.findings.none)}), "
        f"with a gap of {floors(gap.before)} where 1.0 is a healthy rig."
    )
    if not reported.judged:
        return first, "No effect of the catalogue was tried."
    hardest = reported.judged[0]
    second = (
        f"Of the catalogue's {len(reported.judged)} effects, {what_and_where(hardest.cause)} is the hardest "
        f"to rule out ({percent(hardest.probability)})"
    )
    return first, f"{second}{_could_hide(hardest)}."


def _could_hide(one: Judged) -> str:
    if not one.cause.parameters:
        return ""
    parameter = one.cause.parameters[0]
    found = one.parameters[parameter.name]
    hidden = span(found.low, found.high, parameter.unit)
    return f"; it could hide with {parameter_words(parameter)} from {hidden}"


def _unknown(reported: Reported) -> tuple[str, str]:
    first = (
        "Something that no effect of the catalogue explains is in the rig "
        f"(probability {percent(reported.findings.unknown)})"
    )
    if reported.judged:
        nearest = reported.judged[0]
        first += f"; the nearest, {what_and_where(nearest.cause)}, has {percent(nearest.probability)}"
    return f"{first}.", _where(reported)


def _where(reported: Reported) -> str:
    channel, run, size = gaps.largest_channels(reported)[0]
    band = gaps.largest_span(reported, channel, run, lambda cell: cell.band)
    phase = gaps.largest_span(reported, channel, run, lambda cell: cell.phase)
    spots = [f"at {band[0]:.0f} to {band[1]:.0f} Hz"] if band else []
    spots += [f"from {phase[0]:.2f} to {phase[1]:.2f} of the cycle"] if phase else []
    most = f", most {listed(spots)}" if spots else ", much the same all over it"
    return (
        f"The gap is {floors(reported.findings.gap.before)}, where 1.0 is a healthy rig, "
        f"and largest in {channel} ({floors(size)}){most}."
    )
