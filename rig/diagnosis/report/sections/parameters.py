"""The parameters of what was found, or how large what was not found could be."""

from __future__ import annotations

from collections.abc import Sequence

from rig.diagnosis.report.content import Part
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.words import number, parameter_words, percent, plain, plausible, span
from rig.report.content import Sentence, Table
from sim_twin.diagnosis.findings import Judged

_BELIEVED = 0.02
_MOST = 6


def parts(reported: Reported) -> list[Part]:
    """Best values with intervals and the plausible range, of what is selected and of its rivals."""
    selected = {cause.name for cause in reported.findings.selected}
    alike = {
        name
        for each in reported.judged
        if each.cause.name in selected
        for name in each.indistinguishable_from
    }
    found = [each for each in reported.judged if each.cause.name in selected]
    others = [each for each in reported.judged if each not in found]
    rivals = [each for each in others if each.probability >= _BELIEVED or each.cause.name in alike][:_MOST]
    if not found:
        rivals = rivals or others[:_MOST]
    tables: list[Part] = []
    if found:
        tables.append(_table(reported, found, "Selected"))
    if rivals:
        tables.append(
            _table(reported, rivals, "Rivals, each as it would have to be" if found else _COULD_HIDE)
        )
    return tables or [Sentence("No effect of the catalogue was judged.")]


_COULD_HIDE = "Nothing is selected. The most probable effects, each as it would have to be if it were there"


def _table(reported: Reported, judged: Sequence[Judged], caption: str) -> Table:
    written = dict(reported.findings.effects)
    headings = ["effect", "parameter", "value", "95 % interval", "plausible range", "largest cause"]
    headings += ["in effects.json"] if any(each.cause.name in written for each in judged) else []
    rows = []
    for each in judged:
        for k, parameter in enumerate(each.cause.parameters):
            found = each.parameters[parameter.name]
            interval = span(found.low, found.high, parameter.unit)
            row = [
                _effect(each) if k == 0 else "",
                parameter_words(parameter),
                number(found.value, parameter.unit),
            ]
            row += [interval, plausible(parameter), percent(each.probability) if k == 0 else ""]
            if len(headings) > len(row):
                value = written.get(each.cause.name, {}).get(parameter.name)
                row.append("" if value is None else number(float(value), parameter.unit))
            rows.append(row)
    return Table(headings, rows, caption)


def _effect(judged: Judged) -> str:
    cause = judged.cause
    return f"{plain(cause.name)} ({cause.channel})" if cause.channel else plain(cause.name)
