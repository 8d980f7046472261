"""A section that this package adds to every report: the largest force on the table's stop."""

from __future__ import annotations

from collections.abc import Sequence

from impact_table.model import STOP
from rig.pages.content import Part, Section, Sentence
from rig.report.record import RunRecord


def parts(run: RunRecord) -> Sequence[Part]:
    return [
        Sentence(f"{run.whose(origin)}: {tally.peak:.3g} {STOP.unit}")
        for (origin, channel), tally in run.tallies.items()
        if channel == STOP.name
    ]


HARDEST_BLOW = Section("Hardest blow", parts)
