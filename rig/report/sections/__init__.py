"""The sections of the report of a run; their table is in `rig/report/page.py`."""
