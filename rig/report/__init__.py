"""The report of a run: one HTML file that needs nothing else, and its numbers for the terminal."""

from rig.report.page import write_report
from rig.report.summary import ChannelSummary, HalfCycleStatistics, RunSummary, TraceSummary, summarise

__all__ = [
    "ChannelSummary",
    "HalfCycleStatistics",
    "RunSummary",
    "TraceSummary",
    "summarise",
    "write_report",
]
