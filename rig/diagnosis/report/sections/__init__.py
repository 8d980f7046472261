"""The sections of a diagnosis's report in their order: a new one is a file here and a line in the table."""

from __future__ import annotations

from rig.diagnosis.report.content import Section
from rig.diagnosis.report.sections.basis import parts as basis
from rig.diagnosis.report.sections.before_and_after import parts as before_and_after
from rig.diagnosis.report.sections.gap_map import parts as gap_map
from rig.diagnosis.report.sections.latent_force import parts as latent_force
from rig.diagnosis.report.sections.next_experiment import parts as next_experiment
from rig.diagnosis.report.sections.parameters import parts as parameters
from rig.diagnosis.report.sections.ranking import parts as ranking
from rig.diagnosis.report.sections.separability import parts as separability
from rig.diagnosis.report.sections.verdict import parts as verdict

SECTIONS = (
    Section("Verdict", verdict),
    Section("Causes", ranking),
    Section("Gap map", gap_map),
    Section("Latent force", latent_force),
    Section("Before and after", before_and_after),
    Section("Parameters", parameters),
    Section("Not told apart", separability),
    Section("Next experiment", next_experiment),
    Section("Basis", basis),
)
"""Heading and content of each section; one without content is left out."""
