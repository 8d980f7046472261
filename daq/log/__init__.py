"""The log file: one MCAP file a run, readable by any MCAP program through its embedded schemas."""

from daq.log.reader import LogReader, Origin, begins_as_log
from daq.log.records import ClockRecord, Event, Gap, Impact
from daq.log.recover import recover_log, verify_log
from daq.log.writer import LogWriter

__all__ = [
    "ClockRecord",
    "Event",
    "Gap",
    "Impact",
    "LogReader",
    "LogWriter",
    "Origin",
    "begins_as_log",
    "recover_log",
    "verify_log",
]
