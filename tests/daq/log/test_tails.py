"""What a log lacks at its end stands in its ledger too: of what was stopped, and of what recovery dropped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.log.front import CUT, read_summary
from daq.log.reader import LogReader
from daq.log.records import Event, Gap
from daq.log.recover import LOST, UNWRITTEN, recover_log, verify_log
from daq.log.writer import LogWriter
from tests.daq.log.logs import BLOCK, START_NS, block, host_ns, write_ramp

STOPPED = "stopped before its time"


def gaps_of(path: Path) -> list[tuple[str, str, int, int, str]]:
    with LogReader(path) as log:
        return [(gap.origin, gap.channel, gap.first_sample, gap.count, gap.cause) for gap in log.gaps()]


def test_what_was_due_and_never_came_is_a_gap_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        for name in ("came", "short", "never"):
            log.declare("measured", Channel(name, "N"))
        for number, name in ((0, "came"), (0, "short"), (1, "came")):
            log.add_block("measured", block(number, name), START_NS)
        for name in ("came", "short", "never", "undeclared"):
            log.due("measured", name, 2 * BLOCK, START_NS + 5, STOPPED)
    assert gaps_of(path) == [
        ("measured", "short", BLOCK, BLOCK, STOPPED),
        ("measured", "never", 0, 2 * BLOCK, STOPPED),
    ]
    with LogReader(path) as log:
        assert [gap.time_ns for gap in log.gaps()] == [host_ns(block(0)), START_NS + 5]
    assert verify_log(path).sound


def test_a_gap_that_was_told_already_is_not_told_twice(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.declare("measured", Channel("a", "N"))
        log.add_block("measured", block(0), START_NS)
        log.add_gap(Gap(START_NS, "a", BLOCK, 30, "no answer in time"), START_NS)
        log.due("measured", "a", BLOCK + 40, START_NS, STOPPED)
    assert gaps_of(path)[1:] == [("measured", "a", BLOCK + 30, 10, STOPPED)]


def test_gaps_that_were_told_over_one_another_or_ahead_leave_what_is_between(tmp_path: Path) -> None:
    path, told = tmp_path / "log.mcap", [(30, 30), (40, 30), (40, 10), (80, 10), (BLOCK + 10, 5)]
    with LogWriter(path) as log:
        for name in ("a", "b"):
            log.declare("measured", Channel(name, "N"))
            for first, count in told:
                log.add_gap(Gap(START_NS, name, first, count, "told"), START_NS)
            log.due("measured", name, BLOCK + 20, START_NS, STOPPED)
        log.add_block("measured", block(1, "b"), START_NS)
    found = gaps_of(path)[2 * len(told) :]
    between = [(0, 30), (70, 10), (90, BLOCK - 90)]
    assert [each[2:4] for each in found if each[1] == "b"] == between
    assert [each[2:4] for each in found if each[1] == "a"] == [
        *between[:2],
        (90, BLOCK - 80),
        (BLOCK + 15, 5),
    ]


def test_a_gap_behind_one_that_was_told_has_the_time_of_its_first_sample(tmp_path: Path) -> None:
    with LogWriter(path := tmp_path / "log.mcap") as log:
        log.declare("measured", Channel("a", "N"))
        log.add_block("measured", block(0), START_NS)
        log.add_gap(Gap(START_NS, "a", BLOCK, BLOCK, "told"), START_NS)
        log.due("measured", "a", 3 * BLOCK, START_NS, STOPPED)
    with LogReader(path) as log:
        assert log.gaps()[1].time_ns == block(2).time_ns


def test_what_comes_after_it_was_found_due_is_no_gap(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.declare("predicted", Channel("a", "N"))
        log.due("predicted", "a", BLOCK, START_NS, STOPPED)
        log.add_block("predicted", block(0), START_NS)
    assert gaps_of(path) == []


def cut_in_two(path: Path) -> Path:
    """A crashed log in which the last blocks of b are missing."""
    whole = path.with_suffix(".whole.mcap")
    with LogWriter(whole) as log:
        for name in ("a", "b"):
            log.declare("measured", Channel(name, "N"))
        for number in range(20):
            for name in ("a", "b"):
                if name == "a" or number < 18:
                    log.add_block("measured", block(number, name), host_ns(block(number)))
        log.flush_if_older(1 << 62)
    with LogReader(whole) as log:
        ends = [each.start + each.length for each in read_summary(log._file.fileno()).chunks]
    path.write_bytes(whole.read_bytes()[: ends[-1] + 3])
    return path


def test_what_a_crash_cut_off_some_channels_is_in_the_recovered_ledger(tmp_path: Path) -> None:
    report = recover_log(cut_in_two(tmp_path / "cut.mcap"), tmp_path / "recovered.mcap")
    assert report.recovered_from == CUT
    assert report.sound
    assert report.whole
    gaps = gaps_of(tmp_path / "recovered.mcap")
    assert gaps == [("measured", "b", 18 * BLOCK, 2 * BLOCK, UNWRITTEN)]


def test_what_recovery_dropped_at_the_end_is_in_its_ledger(tmp_path: Path) -> None:
    path = write_ramp(tmp_path / "log.mcap", blocks=20)
    with LogReader(path) as log:
        last = max(read_summary(log._file.fileno()).chunks)
    content = bytearray(path.read_bytes())
    content[last.start + last.length - 20] ^= 0xFF
    path.write_bytes(content)
    report = recover_log(path, tmp_path / "recovered.mcap")
    with LogReader(tmp_path / "recovered.mcap") as log:
        ends = {each.channel: each.end_sample for _, each in log.blocks()}
    assert ends["a"] < 20 * BLOCK
    assert gaps_of(tmp_path / "recovered.mcap") == [
        ("measured", name, end, 20 * BLOCK - end, LOST) for name, end in ends.items()
    ]
    assert report.lost == sum(20 * BLOCK - end for end in ends.values())
    assert not report.whole


@pytest.mark.parametrize("cut", [False, True])
def test_what_comes_late_of_other_origins_is_no_sign_of_a_loss(tmp_path: Path, cut: bool) -> None:
    """A twin lags behind the record that it predicts, and events follow what was measured."""
    path, late_ns = tmp_path / "log.mcap", NS_PER_S
    with LogWriter(path) as log:
        for origin, delay_ns in (("measured", 0), ("predicted", late_ns)):
            log.declare(origin, Channel("a", "N"))
            for number in range(20):
                log.add_block(origin, block(number), host_ns(block(number)) + delay_ns)
        log.add_event(Event(host_ns(block(19)) + 2 * late_ns, "info", "rig", "drive.off", "off"))
    if cut:
        path.write_bytes(path.read_bytes()[:-40])
    report = recover_log(path, tmp_path / "recovered.mcap")
    assert gaps_of(tmp_path / "recovered.mcap") == []
    assert report.lost == 0


def test_a_log_that_lacks_nothing_gets_no_gap(tmp_path: Path) -> None:
    path = write_ramp(tmp_path / "log.mcap", blocks=20)
    recover_log(path, tmp_path / "recovered.mcap")
    assert gaps_of(tmp_path / "recovered.mcap") == []
    assert replace(verify_log(path), path=tmp_path).ledger_missing == 0


@pytest.mark.parametrize(("later", "missing"), [(8, 0), (10, 1)])
def test_a_slow_channel_lacks_no_sample_that_was_not_due(tmp_path: Path, later: int, missing: int) -> None:
    """Once a second, and last so many blocks of 0.1 s before the log was cut."""
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        for name in ("a", "slow"):
            log.declare("measured", Channel(name, "N"))
        for number in range(10 + later):
            log.add_block("measured", block(number), host_ns(block(number)))
            if number == 9:
                once = SampleBlock("slow", 0, START_NS, 1.0, np.zeros(1, np.float32))
                log.add_block("measured", once, host_ns(block(number)))
    written = path.read_bytes()
    path.write_bytes(
        written[: written.index(b"\x04\x00\x00\x00ends")]
    )  # before it says where its channels end
    recover_log(path, tmp_path / "recovered.mcap")
    expected = [("measured", "slow", 1, missing, UNWRITTEN)] if missing else []
    assert gaps_of(tmp_path / "recovered.mcap") == expected
