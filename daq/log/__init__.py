"""The log file: one MCAP file a run, readable by any MCAP program through its embedded schemas."""
