"""What goes into a log comes out of it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from daq.block import NS_PER_S, Flag, SampleBlock
from daq.channel import Channel
from daq.errors import LogError, RecorderFailed
from daq.log import codec
from daq.log.reader import LogReader
from daq.log.records import ClockRecord, Event, Gap, Impact
from daq.log.recover import recover_log, verify_log
from daq.log.writer import LogWriter
from tests.daq.log.logs import BLOCK, RATE, START_NS, block, host_ns, write_ramp


@given(
    values=hnp.arrays(st.sampled_from([np.dtype("<f4"), np.dtype("<f8")]), st.integers(0, 300)),
    first=st.integers(0, 2**63 - 1),  # as a signed integer counts
    time_ns=st.integers(0, 2**62),
    flags=st.integers(0, 31),
)
@settings(max_examples=60, deadline=None)
def test_a_block_survives_bit_by_bit(values: np.ndarray, first: int, time_ns: int, flags: int) -> None:
    with np.errstate(all="ignore"):
        data = codec.encode_block(SampleBlock("c", first, time_ns, RATE, values, Flag(flags)))
    found = codec.decode_block("c", data)
    assert (found.first_sample, found.time_ns, found.sample_rate) == (first, time_ns, RATE)
    assert found.flags == Flag(flags)
    if len(values):
        assert found.values.dtype == values.dtype
    assert found.values.tobytes() == values.tobytes()


def test_events_gaps_and_clocks_survive(tmp_path: Path) -> None:
    event = Event(START_NS, "warning", "rig", "limit.warning", "früh")
    gap = Gap(START_NS, "a", 10, 5, "stalled")
    clock = ClockRecord(START_NS, "host", 1e-3, -12.5, 1e-6)
    with LogWriter(tmp_path / "log.mcap") as log:
        log.add_event(event)
        log.add_gap(gap, START_NS)
        log.add_clock(clock)
    with LogReader(tmp_path / "log.mcap") as reader:
        assert (reader.events(), reader.gaps(), reader.clocks()) == ([event], [gap], [clock])


def test_impacts_and_what_is_derived_survive_and_are_recovered(tmp_path: Path) -> None:
    impact = Impact(START_NS + 1, "measured", "a", 7, 90, 40, 33.25, 30.5, 1e-3, 2e-3, 3, 12.375)
    unknown = Impact(START_NS, "predicted", "b", 0, 1, 0, 1.0, 1.0, 1.0, 1.0, 0, float("nan"))
    with LogWriter(tmp_path / "log.mcap") as log:
        log.declare("derived", Channel("a.cycle_rms", "N"))
        log.add_impact(impact, START_NS + 5)
        log.add_block("derived", block(0, "a.cycle_rms"), START_NS + 6)
        log.add_impact(unknown, START_NS + 7)
    assert recover_log(tmp_path / "log.mcap", tmp_path / "recovered.mcap").sound
    for name in ("log", "recovered"):
        with LogReader(tmp_path / f"{name}.mcap") as reader:
            assert [repr(each) for each in reader.impacts()] == [repr(impact), repr(unknown)]
            assert list(reader.channels("derived")) == ["a.cycle_rms"]
            assert [origin for origin, _ in reader.blocks(("derived", "measured"))] == ["derived"]
            assert list(reader.blocks(("measured", "predicted"))) == []


def test_only_chunks_with_the_asked_topics_are_opened(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        for name in ("a", "b"):
            log.declare("measured", Channel(name, "N"))
        for number in range(40):  # 4 s of b after 4 s of a: chunks end after a quarter of a second
            each = block(number, "a" if number < 20 else "b")
            log.add_block("measured", each, host_ns(each))
    content = bytearray(path.read_bytes())
    with path.open("rb") as file:
        chunks = [r for r in StreamReader(file, emit_chunks=True).records if isinstance(r, Chunk)]
    content[content.index(chunks[0].data) + 20] ^= 0xFF
    path.write_bytes(content)
    with LogReader(path) as reader:
        assert len([each for _, each in reader.blocks("measured", ["b"])]) == 20
        with pytest.raises(LogError, match="a chunk is damaged"):
            list(reader.blocks("measured", ["a"]))


def test_a_channel_keeps_its_metadata_even_without_a_sample(tmp_path: Path) -> None:
    channel = Channel("contact.force_upper", "N", "force", "contact", "piezo", "SN1", 41.666, "V")
    with LogWriter(tmp_path / "log.mcap") as log:
        log.declare("measured", channel)
        log.declare("measured", channel)
    with LogReader(tmp_path / "log.mcap") as reader:
        assert reader.complete
        assert reader.channels("measured") == {channel.name: channel}
        with pytest.raises(LogError, match=r"samples of /measured/contact.force_upper: none in"):
            reader.series("measured", channel.name)


@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_a_series_joins_blocks_in_its_own_precision(tmp_path: Path, dtype: str) -> None:
    with LogWriter(tmp_path / "log.mcap") as log:
        log.declare("measured", Channel("a", "rad"))
        for number in range(5):
            log.add_block("measured", block(number, dtype=dtype), host_ns(block(number)))
    with LogReader(tmp_path / "log.mcap") as reader:
        whole = reader.series("measured", "a")
        part = reader.series("measured", "a", start_s=0.15, end_s=0.25)
    assert whole.values.dtype == np.dtype(dtype)
    assert np.array_equal(whole.values, np.arange(5 * BLOCK))
    assert np.array_equal(part.values, np.arange(150, 250))
    assert (part.first_sample, part.time_ns) == (150, START_NS + 150 * NS_PER_S // 1000)


def test_a_gap_is_in_the_ledger_with_its_exact_length(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as log:
        log.declare("measured", Channel("a", "N"))
        for number in (0, 1, 4, 5, 7):
            log.add_block("measured", block(number), host_ns(block(number)))
    with LogReader(tmp_path / "log.mcap") as reader:
        gaps = [(gap.channel, gap.first_sample, gap.count) for gap in reader.gaps()]
        joined = reader.series("measured", "a").values
    assert gaps == [("a", 200, 200), ("a", 600, 100)]
    assert np.flatnonzero(np.isnan(joined)).tolist() == [*range(200, 400), *range(600, 700)]
    report = verify_log(tmp_path / "log.mcap")
    assert report.sound
    assert report.ledger_missing == 300


def test_a_sample_that_comes_twice_is_refused(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as log:
        log.declare("measured", Channel("a", "N"))
        log.add_block("measured", block(3), host_ns(block(3)))
        with pytest.raises(RecorderFailed, match=r"/measured/a: sample 300 comes twice \(next is 400\)"):
            log.add_block("measured", block(3), host_ns(block(3)))


def test_a_log_is_never_overwritten(tmp_path: Path) -> None:
    path = write_ramp(tmp_path / "log.mcap")
    before = path.read_bytes()
    with pytest.raises(RecorderFailed, match=r"exists already"):
        LogWriter(path).open()
    assert path.read_bytes() == before


def chunks_of(path: Path) -> list[Chunk]:
    with path.open("rb") as file:
        return [r for r in StreamReader(file, emit_chunks=True).records if isinstance(r, Chunk)]


def test_a_slow_stream_has_its_chunk_ended_by_age(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as log:
        log.add_event(Event(START_NS, "info", "rig", "a", "one"))
        size = (tmp_path / "log.mcap").stat().st_size
        log.flush_if_older(START_NS + NS_PER_S // 10)
        assert (tmp_path / "log.mcap").stat().st_size == size
        log.flush_if_older(START_NS + round(0.15 * NS_PER_S))
        log._file.flush()
        with LogReader(tmp_path / "log.mcap") as reader:
            assert [event.text for event in reader.events()] == ["one"]


def test_a_wall_clock_that_is_set_back_does_not_hold_a_chunk_open(tmp_path: Path) -> None:
    hour_ns = 3600 * NS_PER_S
    with LogWriter(tmp_path / "log.mcap") as log:
        for number, time_ns in enumerate((START_NS, START_NS - hour_ns, START_NS - hour_ns + NS_PER_S)):
            log.add_event(Event(time_ns, "info", "rig", "a", str(number)))
    assert len(chunks_of(tmp_path / "log.mcap")) == 3


def test_chunks_last_a_quarter_of_a_second_at_most(tmp_path: Path) -> None:
    chunks = chunks_of(write_ramp(tmp_path / "log.mcap"))
    assert all(each.message_end_time - each.message_start_time < NS_PER_S // 4 for each in chunks)
    assert all(later.message_start_time > one.message_end_time for one, later in pairwise(chunks))


@pytest.mark.parametrize("cut", [False, True])
def test_two_passes_over_one_reader_do_not_disturb_each_other(tmp_path: Path, cut: bool) -> None:
    path = write_ramp(tmp_path / "log.mcap", blocks=30)
    if cut:
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    with LogReader(path) as reader:
        assert reader.complete != cut
        alone = [each.first_sample for _, each in reader.blocks("measured", ["a"])]
        both = zip(reader.blocks("measured", ["a"]), reader.blocks("measured", ["b"]), strict=False)
        together = [(a.first_sample, b.first_sample) for (_, a), (_, b) in both]
    assert len(alone) > 10
    assert together == [(first, first) for first in alone]
