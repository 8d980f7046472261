"""Logs made to do harm, or merely odd: an end that is told, little memory, little time."""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel as ChannelRecord
from mcap.records import Chunk, ChunkIndex, DataEnd, Footer, Header, Metadata, MetadataIndex
from mcap.writer import MCAP0_MAGIC

from daq.block import LATEST, NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.errors import LogError
from daq.formats.recording import read_log
from daq.formats.samples import Scratch
from daq.log.codec import EventMessage, SampleBlockMessage, decode_block, encode_block
from daq.log.reader import LogReader
from daq.log.records import Event, Gap
from daq.log.recover import recover_log, verify_log
from daq.log.writer import LogWriter
from tests.daq.log.logs import START_NS, block, crashed_file, host_ns
from tests.hostile import bounded, slowness

MIB = 1 << 20
WITHIN_S = 5.0
"""The promise is 1 s a MiB; under tracemalloc and beside other tests it takes some times as long."""
ZEROS = np.zeros(51_200, np.float32)
ODD = "more would come of it than of any honest recording"


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def chunk(data: bytes) -> Chunk:
    return Chunk("zstd", zstandard.ZstdCompressor().compress(data), 1, 0, 0, len(data))


def finished_file(
    path: Path,
    chunks: Sequence[Chunk],
    claimed: int | None = None,
    index_twice: bool = False,
    indexed: int | None = None,
) -> Path:
    """A file with an index and one channel, whose chunks its index claims to have `claimed` bytes."""
    builder, indexes = RecordBuilder(), []
    Header("", "test").write(builder)
    content = MCAP0_MAGIC + builder.end()
    for each in chunks:
        each.write(builder)
        data = builder.end()
        size = each.uncompressed_size if claimed is None else claimed
        index = ChunkIndex(len(data), len(content), "zstd", len(each.data), 1, 0, {}, 0, size)
        indexes += [index, index] if index_twice else [index]
        content += data
    DataEnd(0).write(builder)
    content += builder.end()
    start = len(content)
    ChannelRecord(0, "/event", "protobuf", {}, 0).write(builder)
    for index in indexes[:indexed]:
        index.write(builder)
    Footer(start, 0, 0).write(builder)
    path.write_bytes(content + builder.end() + MCAP0_MAGIC)
    return path


def ended_within_bounds(path: Path, words: str) -> None:
    begun = time.process_time()
    with bounded():
        report = verify_log(path)
        assert words in report.damage
        assert not report.sound
    assert time.process_time() - begun < WITHIN_S * slowness()


@pytest.mark.parametrize(
    ("claimed", "words"), [(0, "and its index 0"), (None, ODD)], ids=["claimed 0", "true"]
)
def test_a_hundred_chunks_of_zeros(tmp_path: Path, claimed: int | None, words: str) -> None:
    one = chunk(record(0x80, bytes(64 * MIB - 9)))
    ended_within_bounds(finished_file(tmp_path / "log.mcap", [one] * 100, claimed), words)


def test_a_hundred_chunks_of_zeros_without_an_index(tmp_path: Path) -> None:
    one = chunk(record(0x80, bytes(64 * MIB - 9)))
    with bounded(), pytest.raises(LogError, match=ODD):
        LogReader(crashed_file(tmp_path / "log.mcap", *[one] * 100)).open()


@pytest.mark.long
def test_millions_of_empty_messages(tmp_path: Path) -> None:
    one = chunk(record(5, struct.pack("<HIQQ", 0, 0, 0, 0)) * 1_000_000)
    path = finished_file(tmp_path / "log.mcap", [one] * 4)
    assert path.stat().st_size < MIB
    ended_within_bounds(path, ODD)


@pytest.mark.long
@pytest.mark.parametrize("topic", ["/measured/a", "/event"])
def test_millions_of_short_messages_are_not_kept(topic: str, tmp_path: Path) -> None:
    data = SampleBlockMessage(sample_rate=1000.0, first_sample=1, values=[1.0]).SerializeToString()
    data = data if topic != "/event" else EventMessage(level="ab", text="ab").SerializeToString()
    head = record(4, struct.pack("<HHI", 0, 0, len(topic)) + topic.encode() + struct.pack("<II", 0, 0))
    one = chunk(head + record(5, struct.pack("<HIQQ", 0, 0, 0, 0) + data) * 300_000)
    path = crashed_file(tmp_path / "log.mcap", one)
    with LogReader(path) as log, bounded(), pytest.raises(LogError, match=ODD):
        log.series("measured", "a") if topic != "/event" else log.events()


@pytest.mark.parametrize("time_ns", [-1, 0, LATEST - 1])
@pytest.mark.parametrize("sample_rate", [1e-8, 1000.0])
def test_a_hole_that_reaches_out_of_all_time_is_recovered(
    sample_rate: float, time_ns: int, tmp_path: Path
) -> None:
    message = SampleBlockMessage(sample_rate=sample_rate, first_sample=LATEST - 1, values=[1.0, 2.0])
    message.timestamp.seconds, message.timestamp.nanos = divmod(time_ns, NS_PER_S)
    head = record(4, struct.pack("<HHI", 0, 0, 11) + b"/measured/a" + struct.pack("<II", 0, 0))
    one = record(5, struct.pack("<HIQQ", 0, 0, 1, 0) + message.SerializeToString())
    recover_log(crashed_file(tmp_path / "log.mcap", chunk(head + one)), tmp_path / "recovered.mcap")
    with LogReader(tmp_path / "recovered.mcap") as log:
        assert [(gap.time_ns, gap.count) for gap in log.gaps()] == [(0, LATEST - 1)]


@pytest.mark.parametrize("sample_rate", [6e8, 1e9, 1e17])
@pytest.mark.parametrize("cut", [True, False], ids=["cut", "damaged"])
def test_a_time_of_the_host_that_is_past_counting_leaves_a_gap_that_can_be_counted(
    tmp_path: Path, sample_rate: float, cut: bool
) -> None:
    """Of /measured/a by as much as /measured/b seems to come later: 2^64 ns."""
    data = SampleBlockMessage(sample_rate=sample_rate, values=[1.0, 2.0]).SerializeToString()
    inner = b"".join(
        record(4, struct.pack("<HHI", number, 0, 11) + topic + struct.pack("<II", 0, 0))
        + record(5, struct.pack("<HIQQ", number, 0, log_ns, 0) + data)
        for number, topic, log_ns in ((0, b"/measured/a", 0), (1, b"/measured/b", (1 << 64) - 1))
    )
    chunks = [chunk(inner)] if cut else [chunk(inner), Chunk("zstd", b"none", 1, 0, 0, 4)]
    report = recover_log(crashed_file(tmp_path / "log.mcap", *chunks), tmp_path / "recovered.mcap")
    assert report.unverified
    assert report.ledger_missing == LATEST - 1 - 2
    assert report.lost == (0 if cut else report.ledger_missing)


def test_one_chunk_that_the_index_has_twice_is_read_once(tmp_path: Path) -> None:
    one = chunk(record(5, struct.pack("<HIQQ", 0, 0, 0, 0)))
    with LogReader(finished_file(tmp_path / "once.mcap", [one])) as log:
        assert log.complete
        assert len(log.events()) == 1
    with pytest.raises(LogError, match="not a log"):  # its chunk declares no channel
        LogReader(finished_file(tmp_path / "twice.mcap", [one], index_twice=True)).open()


def test_a_chunk_that_the_index_does_not_have_is_told(tmp_path: Path) -> None:
    """Which nobody reads; no statistics count it either."""
    one = chunk(record(5, struct.pack("<HIQQ", 0, 0, 0, 0)))
    path = finished_file(tmp_path / "log.mcap", [one, one], indexed=1)
    assert verify_log(path).damage == "its index has 1 chunks, and its data 2"
    assert recover_log(path, tmp_path / "recovered.mcap").recovered_from == verify_log(path).damage


@pytest.mark.long
def test_chunks_by_the_thousand_inside_one_another(tmp_path: Path) -> None:
    """Behind damage a chunk is looked for byte by byte, and each of these unpacks to 64 MiB."""
    bomb = chunk(record(0x80, bytes(64 * MIB - 9)))
    builder = RecordBuilder()
    bomb.write(builder)
    path = tmp_path / "log.mcap"
    path.write_bytes(MCAP0_MAGIC + b"\xff" + builder.end()[:-1] * 300)
    begun = time.process_time()
    with bounded(), pytest.raises(LogError, match=ODD):
        LogReader(path).open()
    assert time.process_time() - begun < WITHIN_S * slowness()


def far_apart(path: Path, origin: str = "measured", name: str = "a", second: int = 500_000_000) -> Path:
    with LogWriter(path) as log:
        log.declare(origin, Channel(name, "N"))
        for first in (0, second):
            each = SampleBlock(name, first, START_NS + first, 1000.0, np.ones(10, np.float32))
            log.add_block(origin, each, START_NS)
    return path


def test_two_blocks_far_apart_make_no_series(tmp_path: Path) -> None:
    with LogReader(far_apart(tmp_path / "log.mcap")) as log, bounded(16 * MIB):
        with pytest.raises(LogError, match=ODD):
            log.series("measured", "a")
        assert len(log.series("measured", "a", end_s=1.0)) == 10


def test_a_run_that_begins_after_a_year_makes_no_series(tmp_path: Path) -> None:
    """Who predicts it begins at sample 0, and would never come to an end."""
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.declare("measured", Channel("a", "N"))
        late = SampleBlock("a", 1 << 40, START_NS, 51_200.0, np.ones(10, np.float32))
        log.add_block("measured", late, START_NS)
    with LogReader(path) as opened, pytest.raises(LogError, match=ODD):
        opened.series("measured", "a")


def test_two_blocks_far_apart_are_not_exported(tmp_path: Path) -> None:
    path = far_apart(tmp_path / "log.mcap")
    with (
        LogReader(path) as log,
        Scratch(tmp_path) as scratch,
        bounded(16 * MIB),
        pytest.raises(LogError, match=ODD),
    ):
        read_log(log, scratch)


def test_an_hour_with_half_an_hour_missing_is_read(tmp_path: Path) -> None:
    """Of noise, as any sensor gives, at 1 kHz."""
    rng, seconds = np.random.default_rng(1), 60
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.declare("measured", Channel("a", "N"))
        for minute in [*range(15), *range(45, 60)]:
            first = minute * seconds * 1000
            values = rng.normal(size=seconds * 1000).astype(np.float32)
            log.add_block("measured", SampleBlock("a", first, START_NS, 1000.0, values), START_NS)
    with LogReader(path) as log:
        series = log.series("measured", "a")
    assert len(series) == 3_600_000
    assert np.count_nonzero(np.isnan(series.values)) == 1_800_000


@pytest.mark.parametrize("mebibytes", [20, 60])
def test_large_chunks_of_other_writers_are_read_one_at_a_time(tmp_path: Path, mebibytes: int) -> None:
    values = np.random.default_rng(1).normal(size=MIB // 4).astype(np.float32)
    head = record(4, struct.pack("<HHI", 0, 0, 11) + b"/measured/a" + struct.pack("<II", 0, 0))
    chunks = []
    for number in range(3):
        parts = [head]
        for part in range(mebibytes - 1):
            first = (number * (mebibytes - 1) + part) * len(values)
            each = encode_block(SampleBlock("a", first, START_NS, 51_200.0, values))
            parts.append(record(5, struct.pack("<HIQQ", 0, 0, 0, 0) + each))
        data = b"".join(parts)
        chunks.append(Chunk("", data, 1, 0, 0, len(data)))
    path = crashed_file(tmp_path / "log.mcap", *chunks)
    del chunks, data, parts
    with (
        bounded(5 * mebibytes * MIB),
        LogReader(path) as log,
    ):  # record, copy and content, of this and the last
        assert sum(len(each) for _, each in log.blocks()) == 3 * (mebibytes - 1) * len(values)


def test_metadata_without_end_is_left_out(tmp_path: Path) -> None:
    builder = RecordBuilder()
    Metadata("a" * 100, {"toml": "x" * MIB}).write(builder)
    data = builder.end()
    chunks = [Chunk("", record(4, struct.pack("<HHI", 0, 0, 2) + b"/a" + bytes(8)), 1, 0, 0, 27)]
    path = crashed_file(tmp_path / "log.mcap", *chunks)
    path.write_bytes(path.read_bytes() + data * 40)
    with bounded(64 * MIB), LogReader(path) as log:
        assert "is damaged" in log.damage


def test_an_index_of_one_metadata_many_times_is_not_followed(tmp_path: Path) -> None:
    builder = RecordBuilder()
    Header("", "test").write(builder)
    at = len(MCAP0_MAGIC) + builder.count
    Metadata("run", {"note": "x" * MIB}).write(builder)
    DataEnd(0).write(builder)
    content = MCAP0_MAGIC + builder.end()
    ChannelRecord(0, "/event", "protobuf", {}, 0).write(builder)
    for _ in range(20_000):
        MetadataIndex(at, MIB, "run").write(builder)
    Footer(len(content), 0, 0).write(builder)
    path = tmp_path / "log.mcap"
    path.write_bytes(content + builder.end() + MCAP0_MAGIC)
    with bounded(64 * MIB), LogReader(path) as log:
        assert not log.complete
        assert set(log.metadata) == {"run"}


def test_a_summary_of_hours_is_read_piece_by_piece(tmp_path: Path) -> None:
    """As long as what 64 measured and 64 predicted channels make in two and a half."""
    builder, path, places = RecordBuilder(), tmp_path / "log.mcap", dict.fromkeys(range(1000), 1)
    Header("", "test").write(builder)
    DataEnd(0).write(builder)
    start = len(MCAP0_MAGIC) + builder.count
    ChannelRecord(0, "/event", "protobuf", {}, 0).write(builder)
    content = MCAP0_MAGIC + builder.end()
    ChunkIndex(0, 1, "zstd", 1, 1, 0, places, 0, 1).write(builder)
    content += builder.end() * 14_000
    assert len(content) > 128 * MIB
    Footer(start, 0, 0).write(builder)
    path.write_bytes(content + builder.end() + MCAP0_MAGIC)
    with bounded(64 * MIB), LogReader(path) as log:
        assert log.complete


def test_topics_by_the_thousand_are_looked_up_in_one_pass_over_the_index(tmp_path: Path) -> None:
    """Of a thousand chunks, none of which is there: so of each is asked whether it had anything."""
    builder, path, number = RecordBuilder(), tmp_path / "log.mcap", 1000
    Header("", "rattle").write(builder)
    DataEnd(0).write(builder)
    start = len(MCAP0_MAGIC) + builder.count
    for channel in range(number):
        ChannelRecord(channel, f"/measured/{channel}", "protobuf", {}, 0).write(builder)
    content = MCAP0_MAGIC + builder.end()
    ChunkIndex(0, 1, "zstd", 1, 1, 0, dict.fromkeys(range(number), 1), 0, 1).write(builder)
    content += builder.end() * number
    Footer(start, 0, 0).write(builder)
    path.write_bytes(content + builder.end() + MCAP0_MAGIC)
    begun = time.process_time()
    report = recover_log(path, tmp_path / "recovered.mcap")
    assert time.process_time() - begun < WITHIN_S * slowness()
    assert report.untold == tuple(f"/measured/{channel}" for channel in range(number))


def test_channels_by_the_ten_thousand_are_refused(tmp_path: Path) -> None:
    data = b"".join(
        record(4, struct.pack("<HHI", number, 0, 5) + b"%5d" % number + bytes(8)) for number in range(10_000)
    )
    with pytest.raises(LogError, match="more than 4096 channels"):
        LogReader(crashed_file(tmp_path / "log.mcap", Chunk("", data, 1, 0, 0, len(data)))).open()


def test_a_scale_that_is_no_number_is_left_out_and_told(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.register("/measured/a", "SampleBlock", {"unit": "N", "scale": "1,5"})
        log.add_block("measured", block(0), host_ns(block(0)))
    told = f"{path}: the scale of /measured/a is '1,5'"
    assert verify_log(path).damage == told
    with LogReader(path) as opened:
        assert [block.channel for _, block in opened.blocks()] == ["a"]
        assert opened.channels("measured") == {"a": Channel("a", "N")}
    recovered = recover_log(path, tmp_path / "again.mcap")
    assert recovered.sound
    assert recovered.recovered_from == told
    with LogReader(recovered.path) as opened:
        assert opened.topic_metadata()["/measured/a"] == {"unit": "N"}


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"sample_rate": 1e-310}, "sample rate of 1e-310 Hz"),
        ({"sample_rate": 1e300}, "sample rate of 1e\\+300 Hz"),
        ({"sample_rate": 1000.0, "first_sample": (1 << 64) - 1}, "begins at sample"),
    ],
)
def test_what_nobody_can_count_is_a_log_error(fields: dict[str, float], words: str) -> None:
    with pytest.raises(LogError, match=words):
        decode_block("a", SampleBlockMessage(**fields).SerializeToString())


def test_a_time_past_counting_is_a_log_error() -> None:
    message = SampleBlockMessage(sample_rate=1000.0)
    message.timestamp.seconds = 1 << 40
    with pytest.raises(LogError, match="no log holds a time"):
        decode_block("a", message.SerializeToString())


def test_a_gap_past_counting_is_a_log_error(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.add_gap(Gap(START_NS, "a", 0, (1 << 64) - 1, "x"), START_NS)
    assert "counts further" in verify_log(path).damage


def test_unpacked_samples_by_the_million_take_little(tmp_path: Path) -> None:
    data = SampleBlockMessage(sample_rate=1000.0).SerializeToString() + b"\x25\0\0\x80\x3f" * 4_000_000
    with bounded():
        begun = time.process_time()
        values = decode_block("a", data).values
        assert time.process_time() - begun < WITHIN_S * slowness()
    assert len(values) == 4_000_000
    assert values.min() == values.max() == 1.0


def test_many_events_of_one_kind_are_read(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        for number in range(10_000):
            log.add_event(Event(START_NS + number, "info", "rig", "a", "b"))
    with LogReader(path) as opened:
        assert len(opened.events()) == 10_000


@pytest.mark.long
def test_samples_by_the_hundred_thousand_one_by_one_are_read(tmp_path: Path) -> None:
    """Fifty slow channels for ten minutes, in chunks as another program may cut them."""
    number, parts, chunks = 300_000, [], []
    head = record(4, struct.pack("<HHI", 0, 0, 11) + b"/measured/a" + struct.pack("<II", 0, 0))
    for first in range(number):
        each = SampleBlock("a", first, START_NS + first, 10.0, np.zeros(1, np.float32))
        parts.append(record(5, struct.pack("<HIQQ", 0, first, 0, 0) + encode_block(each)))
        if len(parts) == 10_000:
            chunks.append(chunk(head + b"".join(parts)))
            parts = []
    with LogReader(crashed_file(tmp_path / "log.mcap", *chunks)) as log:
        assert len(log.series("measured", "a")) == number


@pytest.mark.long
def test_a_long_log_of_constants_is_read(tmp_path: Path) -> None:
    """Three minutes of 64 channels that stand still shrink to less than a four-hundredth."""
    path = tmp_path / "log.mcap"
    names = [f"c{number}" for number in range(64)]
    with LogWriter(path) as log:
        for name in names:
            log.declare("predicted", Channel(name, "N"))
        for number in range(180):
            data = encode_block(SampleBlock("a", number * 51_200, START_NS, 51_200.0, ZEROS))
            for name in names:
                each = SampleBlock(name, number * 51_200, START_NS, 51_200.0, ZEROS)
                log.add_encoded_block("predicted", each, data, START_NS + number * 1_000_000_000)
    assert path.stat().st_size * 400 < (samples := 180 * 64 * 51_200) * 4
    with LogReader(path) as opened:
        assert sum(len(block) for _, block in opened.blocks()) == samples
