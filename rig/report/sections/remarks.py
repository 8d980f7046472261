"""What a section cannot show of a run, and why."""

from __future__ import annotations

from collections.abc import Sequence

from rig.pages.content import Sentence
from rig.report.crank_figures import beside_turns, counted_by, turned_backwards
from rig.report.record import ORIGINS, RunRecord


def cut(run: RunRecord) -> list[Sentence]:
    """One sentence where a section draws but the beginning of a run, else none."""
    kept_s = run.kept_s
    return [] if kept_s is None else [Sentence(f"This is of the first {kept_s:.0f} s of the run only.")]


def left_out(run: RunRecord, channels: Sequence[str]) -> list[Sentence]:
    """Sentences where some of `channels` have a sampling rate of their own or a shaft turned backwards."""
    turning = [origin for origin in ORIGINS if counted_by(run, origin)]
    beside = {(origin, name) for origin in turning for name in beside_turns(run, origin, channels)}
    missing = [
        f"{name} ({run.whose(origin)})"
        for origin in turning
        for name in channels
        if (origin, name) in run.traces and (origin, name) not in beside
    ]
    backwards = [run.whose(origin) for origin in ORIGINS if turned_backwards(run, origin)]
    told = []
    if missing:
        rate = "Left out, sampled at another rate than what tells the angle"
        told.append(Sentence(f"{rate}: {', '.join(missing)}."))
    if backwards:
        text = "an angle that falls counts no revolutions, neither for orders nor for the mean revolution."
        told.append(Sentence(f"The crank turned backwards ({', '.join(backwards)}): {text}"))
    return told
