"""What these sensors and settings cannot tell apart."""

from __future__ import annotations

from rig.diagnosis.report.content import Part
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.words import percent, plain
from rig.report.content import Sentence, Table

_ALIKE, _HARDLY = 0.75, 0.95
_MATRIX = (
    "Twin against twin: how many of a hundred rigs with the effect of the row, as it may be here, are not "
    "taken for one with the effect of the column; 50 % is a coin."
)


def parts(reported: Reported) -> list[Part]:
    """Sentences for the pairs that look alike, and the matrix."""
    found = reported.findings.separability
    if not found:
        return [Sentence("Fewer than two effects were compared, so nothing is said about what looks alike.")]
    return [*_pairs(reported), Sentence(_MATRIX), _matrix(reported)]


def _pairs(reported: Reported) -> list[Part]:
    """Of each pair, the direction in which it is told apart worse."""
    worst: dict[tuple[str, str], float] = {}
    for (one, other), share in reported.findings.separability.items():
        pair = (min(one, other), max(one, other))
        worst[pair] = min(share, worst.get(pair, 1.0))
    lines = [
        _line(pair, share)
        for pair, share in sorted(worst.items(), key=lambda each: each[1])
        if share < _HARDLY
    ]
    return list(lines) or [Sentence("Whatever was compared is told apart in 95 of 100 cases or more.")]


def _line(pair: tuple[str, str], share: float) -> Sentence:
    how = "cannot tell" if share < _ALIKE else "can hardly tell"
    return Sentence(
        f"These sensors and settings {how} {plain(pair[0])} from {plain(pair[1])}: "
        f"right in {percent(share)} of cases.",
        warning=share < _ALIKE,
    )


def _matrix(reported: Reported) -> Table:
    found = reported.findings.separability
    names = list(dict.fromkeys(one for one, _ in found))
    rows = [
        [plain(one), *(percent(found[one, other]) if (one, other) in found else "" for other in names)]
        for one in names
    ]
    return Table(["", *map(plain, names)], rows)
