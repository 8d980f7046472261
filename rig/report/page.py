"""The report of a run: its sections in their order, and what other packages add to them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

from daq.plugins import UNUSED, plugins
from rig.pages.content import Part, Section, Sentence, page
from rig.report.record import RunRecord
from rig.report.sections import impacts, log, overlays, spectra, speed, summary, whole_run

ReportSection: TypeAlias = Section[RunRecord]
GROUP = "rattle.report_sections"
"""Entry points of this group are `Section`s of a run's report."""

SECTIONS: Mapping[str, ReportSection] = {
    "summary": Section("Summary", summary.parts),
    "overlays": Section("In time and over the cycle", overlays.parts),
    "whole": Section("The whole run", whole_run.parts),
    "speed": Section("Speed of the crank", speed.parts),
    "impacts": Section("Impacts over the crank angle", impacts.parts),
    "revolution": Section("One revolution", overlays.revolution),
    "orders": Section("Orders", spectra.orders),
    "peaks": Section("Peak forces", impacts.peaks),
    "spectra": Section("Autospectra", spectra.parts),
    "events": Section("Events and gaps", log.events),
    "scenario": Section("Scenario", log.scenario),
    "provenance": Section("Provenance", log.provenance),
}
"""Heading and content of each section; what has nothing to say of a rig is left out of its report."""


def write_report(run: RunRecord, html: Path) -> None:
    """Write the report of a run that has been read; raises OSError where `html` cannot be written."""
    html.write_text(render(run), encoding="utf-8")


def render(run: RunRecord) -> str:
    """The page of a run that has been read; sections of other packages come before the events."""
    added = plugins(GROUP, Section, taken=SECTIONS)
    made = {name: (section.heading, section.parts(run)) for name, section in SECTIONS.items()}
    made["summary"][1].extend(Sentence(fault, warning=True) for fault in added.faults)
    beyond: list[tuple[str, list[Part]]] = []
    for name, section in added.found.items():
        try:
            beyond.append((section.heading, list(section.parts(run))))
        except Exception as error:  # another package's code: it costs its own section
            told = f"{GROUP}: {name} failed ({type(error).__name__}: {error})"
            beyond.append((section.heading, [Sentence(told, warning=True)]))
            UNUSED.append(told)
    own, at = list(made.values()), list(made).index("events")
    identity = run.metadata.get("run", {})
    subtitle = [run.facts.rig.replace("_", " "), identity.get("id", ""), identity.get("started", "")]
    subtitle += [f"{key}: {value}" for key, value in run.facts.notes.items()]
    return page(run.facts.name or run.path.stem, subtitle, [*own[:at], *beyond, *own[at:]])
