"""The sections of a report in their order: a new one is a file here and a line in the table."""

from rig.report.content import Section
from rig.report.sections.blows import parts as blows
from rig.report.sections.events import parts as events
from rig.report.sections.orders import parts as orders
from rig.report.sections.overlays import parts as overlays
from rig.report.sections.peaks import parts as peaks
from rig.report.sections.provenance import parts as provenance
from rig.report.sections.revolution import parts as revolution
from rig.report.sections.scenario import parts as scenario
from rig.report.sections.spectra import parts as spectra
from rig.report.sections.speed import parts as speed
from rig.report.sections.summary import parts as summary

SECTIONS = (
    Section("Summary", summary),
    Section("First impacts and one cycle", overlays),
    Section("Speed of the crank", speed),
    Section("Impacts over the crank angle", blows),
    Section("One revolution", revolution),
    Section("Orders", orders),
    Section("Peak forces", peaks),
    Section("Autospectra", spectra),
    Section("Events and gaps", events),
    Section("Scenario", scenario),
    Section("Provenance", provenance),
)
"""Heading and content of each section; what has nothing to say of a rig is left out of its report."""
