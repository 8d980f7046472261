"""Puts the report of a diagnosis together: one HTML file that opens anywhere and asks for nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rig.diagnosis.report import basis, before_and_after, causes, gap_map, latent_force, verdict
from rig.diagnosis.report.case import Case, RunFacts
from rig.pages.content import Section
from rig.pages.page import page
from sim_twin.diagnosis.findings import Findings
from sim_twin.diagnosis.latent_force import LatentForce

SECTIONS: Sequence[Section[Case]] = (
    Section("Verdict", verdict.parts),
    Section("Causes", causes.ranking),
    Section("Gap map", gap_map.parts),
    Section("Latent force", latent_force.parts),
    Section("Before and after", before_and_after.parts),
    Section("Parameters", causes.parameters),
    Section("Not told apart", causes.not_told_apart),
    Section("Next experiment", basis.next_experiment),
    Section("Basis", basis.basis),
)
"""Heading and content of each section; one without content is left out."""


def write_report(
    path: Path,
    findings: Findings,
    diagnosis: Mapping[str, Any],
    runs: Sequence[RunFacts],
    remarks: Sequence[str],
    forces: Sequence[LatentForce] = (),
) -> None:
    """Write the report of a diagnosis as HTML; raises OSError where `path` cannot be written.

    The rest is what a `Case` holds.
    """
    case = Case(findings, diagnosis, runs, remarks, forces, path.parent)
    sections = [(section.heading, section.parts(case)) for section in SECTIONS]
    path.write_text(page("Diagnosis", [run.name for run in runs], sections), encoding="utf-8")
