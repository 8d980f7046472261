"""Puts the report of a diagnosis together: one HTML file that opens anywhere and asks for nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rig.diagnosis.report import before_and_after, causes, gap_map, verdict
from rig.diagnosis.report.case import Case
from rig.pages.content import Section, page

SECTIONS: Sequence[Section[Case]] = (
    Section("Verdict", verdict.parts),
    Section("Causes", causes.ranking),
    Section("Gap map", gap_map.parts),
    Section("Latent force", before_and_after.latent_force),
    Section("Before and after", before_and_after.parts),
    Section("Parameters", causes.parameters),
    Section("Not told apart", causes.not_told_apart),
    Section("Next experiment", causes.next_experiment),
    Section("Basis", causes.basis),
)
"""Heading and content of each section; one without content is left out."""


def write_report(path: Path, case: Case) -> None:
    """Write the report of a diagnosis as HTML; raises OSError where `path` cannot be written."""
    sections = [(section.heading, section.parts(case)) for section in SECTIONS]
    path.write_text(page("Diagnosis", [run.name for run in case.runs], sections), encoding="utf-8")
