"""The report of a run: one HTML file that needs nothing else, and its numbers for the terminal."""

from rig.report.closeness import Closeness, overall_closeness
from rig.report.page import write_report
from rig.report.record import RunCollector
from rig.report.summary import (
    ChannelSummary,
    HalfCycleStatistics,
    RunSummary,
    TraceSummary,
    summarise,
    summary_of,
)

__all__ = [
    "ChannelSummary",
    "Closeness",
    "HalfCycleStatistics",
    "RunCollector",
    "RunSummary",
    "TraceSummary",
    "overall_closeness",
    "summarise",
    "summary_of",
    "write_report",
]
