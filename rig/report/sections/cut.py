"""What is of the beginning of a long run only."""

from __future__ import annotations

from rig.report.content import Sentence
from rig.report.record import RunRecord


def cut(run: RunRecord) -> list[Sentence]:
    """One sentence where a section draws but the beginning of a run, else none."""
    kept_s = run.kept_s
    return [] if kept_s is None else [Sentence(f"This is of the first {kept_s:.0f} s of the run only.")]
