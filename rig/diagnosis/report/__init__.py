"""The report of a diagnosis: one HTML file that needs nothing else."""

from rig.diagnosis.report.page import write_report
from rig.diagnosis.report.reported import RunFacts

__all__ = ["RunFacts", "write_report"]
