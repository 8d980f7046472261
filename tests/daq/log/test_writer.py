"""What a log holds before its first samples."""

from __future__ import annotations

from pathlib import Path

from daq.block import NS_PER_S
from daq.channel import Channel
from daq.log.reader import LogReader
from daq.log.records import Event
from daq.log.writer import LogWriter
from tests.daq.log.logs import START_NS, block


def test_a_log_that_ends_before_its_first_sample_tells_of_which_run_it_is(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "a.mcap").open()
    writer.add_metadata("run", {"id": "a"})
    with LogReader(tmp_path / "a.mcap") as log:
        assert log.metadata["run"] == {"id": "a"}
    writer.close()


def test_in_quiet_a_block_goes_to_the_file_at_once_and_what_follows_it_closely_waits(tmp_path: Path) -> None:
    """A crash costs what had not come; a chunk declares all channels anew, so not every message is one."""
    path = tmp_path / "a.mcap"

    def in_file() -> tuple[int, int]:
        with LogReader(path) as log:
            return sum(1 for _ in log.blocks()), len(log.events())

    with LogWriter(path) as writer:
        writer.add_metadata("run", {"id": "a"})
        writer.declare("measured", Channel("a", "N"))
        for number in range(3):
            now_ns = START_NS + number * NS_PER_S // 10
            writer.add_block("measured", block(number), now_ns)
            assert in_file() == (number, max(number - 1, 0))
            writer.flush_if_older(now_ns + NS_PER_S // 50, quiet=True)
            assert in_file() == (number + 1, number)
            event_ns = now_ns + NS_PER_S // 25
            writer.add_event(Event(event_ns, "info", "rig", "x", "y"))
            writer.flush_if_older(event_ns + NS_PER_S // 50, quiet=True)
            assert in_file() == (number + 1, number)
