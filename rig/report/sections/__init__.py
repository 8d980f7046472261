"""The sections of a report in their order: a new one is a file here and a line in the table."""

from rig.report.content import Section
from rig.report.sections import events, overlays, peaks, provenance, scenario, spectra, summary

SECTIONS = (
    Section("Summary", summary.parts),
    Section("First impacts and one cycle", overlays.parts),
    Section("Peak forces", peaks.parts),
    Section("Autospectra", spectra.parts),
    Section("Events and gaps", events.parts),
    Section("Scenario", scenario.parts),
    Section("Provenance", provenance.parts),
)
"""Heading and content of each section."""
