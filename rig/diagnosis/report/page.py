"""Puts the report of a diagnosis together: one HTML file that opens anywhere and asks for nothing."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
from plotly.offline import get_plotlyjs

from rig.diagnosis.report.reported import Reported, RunFacts
from rig.diagnosis.report.sections import SECTIONS
from sim_twin.diagnosis.findings import Findings
from sim_twin.diagnosis.latent_force import LatentForce


def write_report(
    path: Path,
    findings: Findings,
    diagnosis: Mapping[str, Any],
    runs: Sequence[RunFacts],
    remarks: Sequence[str],
    forces: Sequence[LatentForce] = (),
) -> None:
    """Write the report of a diagnosis as HTML; raises OSError where `path` cannot be written.

    `diagnosis` is what its file holds (interface.md), `remarks` say what was lost of the recordings,
    `forces` what the joints' forces lack.
    """
    page = render(Reported(findings, diagnosis, runs, remarks, forces, path.parent))
    path.write_text(page, encoding="utf-8")


def render(reported: Reported) -> str:
    """Return the page."""
    return _template().render(
        title="Diagnosis",
        subtitle=" · ".join(run.name for run in reported.runs),
        sections=[(section.heading, parts) for section in SECTIONS if (parts := section.parts(reported))],
        plotly=get_plotlyjs(),
    )


@functools.cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rig", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("diagnosis/report/page.html.j2")
