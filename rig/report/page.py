"""Puts a report together: one HTML file that opens anywhere and asks for nothing."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import jinja2
from plotly.offline import get_plotlyjs

from rig.report.content import Part
from rig.report.record import RunRecord
from rig.report.scenario_facts import scenario_facts
from rig.report.sections import SECTIONS


def write_report(run: RunRecord, html: Path) -> None:
    """Write the report of a run that has been read; raises OSError where `html` cannot be written."""
    html.write_text(render(run), encoding="utf-8")


def render(run: RunRecord) -> str:
    """Return the page of a run that has been read."""
    facts = scenario_facts(run.scenario)
    identity = run.metadata.get("run", {})
    subtitle = [facts.rig.replace("_", " "), identity.get("id", ""), identity.get("started", "")]
    made = [(section.heading, section.parts(run)) for section in SECTIONS]
    sections = [(heading, parts) for heading, parts in made if parts]
    return page(facts.name or run.path.stem, subtitle, sections)


def page(title: str, subtitle: Sequence[str], sections: Sequence[tuple[str, Sequence[Part]]]) -> str:
    """Return the page of sections, each a heading with its parts."""
    return _template().render(
        title=title,
        subtitle=" · ".join(text for text in subtitle if text),
        sections=sections,
        plotly=get_plotlyjs(),
    )


@functools.cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rig.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2")
