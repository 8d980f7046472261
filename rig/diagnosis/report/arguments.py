"""A cycle of each, what the runner-up predicts otherwise, and what each run says by itself and over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from rig.diagnosis.argument import SAME, speaks_for_answer
from rig.diagnosis.report.before_and_after import LINES
from rig.diagnosis.report.case import Case, cell_words, floors, parameter_words, plain, unit_words
from rig.pages.content import Part, Sentence, Table
from rig.pages.plots import Plots
from rig.pages.words import DASH, counted, estimate, listed, probability, span
from sim_twin.diagnosis.cause import effects_of

_ROW_PX = 190
_NAMES = {"measured": "measured", "nominal": "nominal twin", "repaired": "repaired twin"}
_CYCLE = (
    "One cycle of each, the one nearest to the middle of all its cycles. The motion does not repeat: compare "
    "when it strikes, how hard and how often, not the ripples between."
)
_DIFFER = "Figures in which both differ most"
_APART = (
    "Apart: how far both predictions are from each other, in what healthy rigs differ by. Levels in dB are "
    "against the nominal twin's."
)
_COURSE = (
    "Gap of each part of a run in its order, before and after. A rig that is the same all along has much the "
    "same gap in all of them; one that loosens, wears or warms up has not."
)
_SETTINGS = (
    "What each run says by itself, of what all of them together leave in question. An effect that is in the "
    "rig has the same size in every run; one that stands for another changes with the setting."
)
_LEFT = (
    "What the best explanation leaves: figures of the recordings that lie farther off than those of one in a "
    "hundred rigs as it says, and how many times as far. Something unknown shows there."
)
_CHANGED = 1.5
UNKNOWN_ENOUGH = 0.2
"""Probability of something unknown from which on the report looks for it."""


def typical_cycle(case: Case) -> list[Part]:
    """A plot below the other for each of the channels that are furthest off."""
    cycles = case.diagnosis.get("typical_cycle", [])
    if not cycles:
        return []
    plots = Plots(len(cycles), 1, _ROW_PX, legend=True)
    for row, each in enumerate(cycles):
        where = f", {case.run_name(each['run'])}" if len(case.run_numbers) > 1 else ""
        x = {"range": [0, 1]}
        title = "part of the cycle" if row == len(cycles) - 1 else ""
        plots.axes(row, each["channel"] + where, title, unit_words(each["unit"]), x_axis=x, share_x_with=0)
        for whose, name in _NAMES.items():
            if whose in each:
                style = replace(LINES[name], width=0.7 * LINES[name].width)
                plots.line(row, name, each[whose]["phase"], each[whose]["values"], style)
    return [plots.figure("typical-cycle", _CYCLE)]


def what_does_not_fit(case: Case) -> list[Part]:
    """The figures that the best explanation leaves, where something unknown may be in the rig."""
    rows = [[_figure(each), f"{each['times']:.1f}"] for each in case.diagnosis.get("not_fitting", [])]
    if case.findings.unknown < UNKNOWN_ENOUGH or not rows:
        return []
    return [Sentence(_LEFT), Table(["figure", "times as far off"], rows, "What does not fit", words=True)]


def _figure(each: Mapping[str, Any]) -> str:
    whose = f"{each['channel']} with {each['with']}" if each["with"] else each["channel"]
    where = f", about {estimate(each['about_hz'], 'Hz')}" if each["about_hz"] else ""
    return f"{whose}: {each['what']}{where}"


def why_not(case: Case) -> list[Part]:
    """The runner-up's predictions beside those of what was selected, and what was measured."""
    found, rows = case.findings, case.diagnosis.get("contrasts", [])
    if found.runner_up is None or not rows:
        return [Sentence("No other explanation was simulated to compare with.")]
    rival = f"with {_together(cause.name for cause in found.runner_up[0])}"
    ours = f"with {_together(cause.name for cause in found.selected)}" if case.repaired else "nominal twin"
    several = len(case.run_numbers) > 1
    table, right = [], 0
    for each, contrast in zip(rows, found.contrasts, strict=True):
        nearer = speaks_for_answer(each)
        right += nearer
        row = [cell_words(case.cells[contrast.cell]), *([case.run_name(each["run"])] if several else [])]
        row += [estimate(each[whose], _unit(each)) for whose in ("measured", "selected", "runner_up")]
        table.append([*row, f"{contrast.apart:.1f}", "answer" if nearer else "next best"])
    text = f"Next best is a twin {rival}. "
    if found.contrasts[0].apart < SAME:
        text += "Nowhere do both differ by more than healthy rigs do: these runs cannot tell them apart."
    else:
        text += f"Where both differ most, {right} of {counted(len(rows), 'figure')} speak for "
        text += f"the twin {ours}." if case.repaired else "the nominal twin."
    headings = ["figure", *(["run"] if several else []), "measured", ours, rival, "apart", "speaks for"]
    return [Sentence(text), Table(headings, table, _DIFFER, words=True), Sentence(_APART)]


def _unit(row: Mapping[str, Any]) -> str:
    return unit_words(row["unit"]) if row["unit"] else ""


def _together(names: Any) -> str:
    return listed([plain(name) for name in dict.fromkeys(names)])


def run_by_run(case: Case) -> list[Part]:
    """What each of several runs says alone, and the gap over the time of each."""
    return [*_alone(case), *_course(case)]


def _alone(case: Case) -> list[Part]:
    rows = case.diagnosis.get("runs_alone", [])
    if not rows:
        return []
    best = effects_of(case.findings.alone[0].best) if case.findings.verdict != "none" else ()
    sizes = [[_size(one) for one in each["parameters"]] for each in rows] if best else [[] for _ in rows]
    parameters = [
        f"{plain(cause.name)}, {parameter_words(parameter)}"
        for cause in best
        for parameter in cause.parameters
    ]
    table = []
    for each, found in zip(rows, sizes, strict=True):
        first, *others = each["believed"]
        other = f"{_what(others[0])} {probability(others[0]['share'])}" if others else DASH
        row = [case.run_name(each["run"]), _what(first), probability(first["share"]), other]
        table.append([*row, *found, *[DASH] * (len(parameters) - len(found))])
    apart = [
        name
        for k, name in enumerate(parameters)
        if _contradict([each["parameters"][k]["ci95"] for each in rows if len(each["parameters"]) > k])
    ]
    told = [Sentence(_SETTINGS)]
    if apart:
        told.append(Sentence(f"The runs contradict each other in {listed(apart)}.", warning=True))
    headings = ["run alone", "says", "probability", "next", *parameters]
    return [*told, Table(headings, table, "Runs by themselves", words=True)]


def _what(believed: Mapping[str, Any]) -> str:
    return _together(believed["effects"]) if believed["effects"] else "nothing missing"


def _size(one: Mapping[str, Any]) -> str:
    low, high = one["ci95"]
    return f"{estimate(one['value'], one['unit'])} ({span(low, high, one['unit'])})"


def _contradict(intervals: Sequence[Sequence[float]]) -> bool:
    return bool(intervals) and max(low for low, _ in intervals) > min(high for _, high in intervals)


def _course(case: Case) -> list[Part]:
    course = [each for each in case.diagnosis.get("gap", {}).get("course", []) if each["before"]]
    count = max((len(each["before"]) for each in course), default=0)
    if count < 2:
        return []
    rows = []
    for each in course:
        gaps = [floors(gap) for gap in each["before"]]
        if each["after"]:
            gaps = [f"{gap} → {floors(after)}" for gap, after in zip(gaps, each["after"], strict=True)]
        rows.append([case.run_name(each["run"]), *gaps])
    changed = [
        case.run_name(each["run"])
        for each in course
        if max(each["before"]) > 1 and max(each["before"]) > _CHANGED * min(each["before"])
    ]
    text = f" It changes in {listed(changed)}." if changed else ""
    edges = [f"{100 * k / count:.0f}" for k in range(count + 1)]
    parts = [f"{low} to {high} %" for low, high in pairwise(edges)]
    return [
        Sentence(_COURSE + text, warning=bool(changed)),
        Table(["run", *parts], rows, "Gap over time"),
    ]
