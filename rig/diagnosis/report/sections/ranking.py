"""Every effect of the catalogue with its probability."""

from __future__ import annotations

from rig.diagnosis.report.content import Bar, BarTable, Part
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.words import floors, percent, plain
from rig.report.content import Sentence
from sim_twin.diagnosis.findings import Judged

_HEADINGS = ("", "probability", "where", "gap with it alone", "shrink", "not told apart from")
_HOW = (
    "Of an effect: that it is the largest cause. Nothing missing, all effects and unknown add up to 100 %. "
    "Gap and shrink are those of a twin with that effect alone."
)


def parts(reported: Reported) -> list[Part]:
    """Bars, "nothing" and "unknown" among them."""
    found = reported.findings
    bars = [_bar(each) for each in reported.judged]
    bars.append(
        Bar("nothing missing", found.none, percent(found.none), ("", floors(found.gap.before), "", ""), True)
    )
    bars.append(
        Bar("unknown to the catalogue", found.unknown, percent(found.unknown), ("", "", "", ""), True)
    )
    return [BarTable(_HEADINGS, sorted(bars, key=lambda bar: -bar.share)), Sentence(_HOW)]


def _bar(judged: Judged) -> Bar:
    cause = judged.cause
    where = f"{cause.location}, {cause.channel}" if cause.channel else cause.location
    alike = ", ".join(plain(name) for name in judged.indistinguishable_from)
    return Bar(
        plain(cause.name),
        judged.probability,
        percent(judged.probability),
        (where, floors(judged.after), _shrink(judged.shrink), alike),
    )


def _shrink(share: float | None) -> str:
    if share is None:
        return "–"
    return "grows" if share < 0 else f"{100 * share:.0f} %"
