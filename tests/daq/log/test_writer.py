"""What a log holds before its first samples."""

from __future__ import annotations

from pathlib import Path

from daq.log.reader import LogReader
from daq.log.writer import LogWriter


def test_a_log_that_ends_before_its_first_sample_tells_of_which_run_it_is(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "a.mcap").open()
    writer.add_metadata("run", {"id": "a"})
    with LogReader(tmp_path / "a.mcap") as log:
        assert log.metadata["run"] == {"id": "a"}
    writer.close()
