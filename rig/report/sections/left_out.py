"""Which channels cannot be shown over the crank's angle."""

from __future__ import annotations

from collections.abc import Sequence

from rig.report.content import Sentence
from rig.report.record import ORIGINS, RunRecord
from rig.report.turning import beside_turns, counted_by


def left_out(run: RunRecord, channels: Sequence[str]) -> list[Sentence]:
    """One sentence where some of `channels` have another sampling rate than the crank's angle, else none."""
    turning = [origin for origin in ORIGINS if counted_by(run, origin)]
    beside = {(origin, name) for origin in turning for name in beside_turns(run, origin, channels)}
    missing = [
        f"{name} ({run.whose(origin)})"
        for origin in turning
        for name in channels
        if (origin, name) in run.traces and (origin, name) not in beside
    ]
    if not missing:
        return []
    return [Sentence(f"Left out, sampled at another rate than what tells the angle: {', '.join(missing)}.")]
