"""Crashed, cut, flipped and hostile files: a prefix or an error, never wrong samples, never all memory."""

from __future__ import annotations

import random
import resource
import signal
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC, IndexType

from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.errors import LogError
from daq.log import recover
from daq.log.codec import decode_block, encode_block
from daq.log.front import CUT, read_summary
from daq.log.reader import LogReader
from daq.log.records import Gap
from daq.log.recover import LOST, recover_log, verify_log
from daq.log.writer import LogWriter
from tests.daq.log.logs import BLOCK, START_NS, block, crashed_file, host_ns, write_foreign, write_ramp

CUTS = 40
FLIPS = 150


@pytest.fixture(scope="module")
def ramp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_ramp(tmp_path_factory.mktemp("ramp") / "log.mcap", blocks=20)


def data_end(path: Path) -> int:
    """Byte at which the last chunk ends."""
    with path.open("rb") as file:
        ends = [file.tell() for r in StreamReader(file, emit_chunks=True).records if isinstance(r, Chunk)]
    return ends[-1]


def heads_of(content: bytes) -> Iterator[int]:
    """Every byte of the kind and length of each record."""
    position = len(MCAP0_MAGIC)
    while position < len(content):
        yield from range(position, position + 9)
        position += 9 + int.from_bytes(content[position + 1 : position + 9], "little")


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """No file of this process gets longer meanwhile."""
    before, heard = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, heard)


def chunks_of(path: Path) -> list[tuple[int, int]]:
    """First byte and end of each chunk."""
    with LogReader(path) as log:
        indexes = read_summary(log._file.fileno()).chunks
    return [(each.start, each.start + each.length) for each in indexes]


@pytest.mark.parametrize("share", [0.001, *np.linspace(0.05, 0.999, CUTS)])
def test_recovering_a_cut_log_gives_a_prefix(ramp: Path, tmp_path: Path, share: float) -> None:
    whole = ramp.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(share * len(whole))])
    if share < 0.02:
        with pytest.raises(LogError, match="not a log"):
            recover_log(cut, tmp_path / "recovered.mcap")
        return
    report = recover_log(cut, tmp_path / "recovered.mcap")
    assert report.sound
    with LogReader(tmp_path / "recovered.mcap") as log:
        assert log.scenario == 'name = "ramp"'
        for _, block in log.blocks():
            assert np.array_equal(block.values, np.arange(block.first_sample, block.end_sample))
    assert all(topic.missing == 0 for topic in report.topics)


def test_a_cut_log_says_that_it_was_cut(ramp: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(ramp.read_bytes()[: data_end(ramp) + 3])
    report = verify_log(cut)
    assert not report.complete
    assert not report.sound
    assert {topic.samples for topic in report.topics} == {20 * BLOCK}


@pytest.mark.parametrize("crashed", [False, True], ids=["with its summary", "without"])
def test_a_flipped_bit_is_never_read_as_a_sample(ramp: Path, tmp_path: Path, crashed: bool) -> None:
    whole = bytearray(ramp.read_bytes())
    end = chunks_of(ramp)[-1][0] if crashed else data_end(ramp)  # up to the last checksum of all before it
    content = whole[:end] if crashed else whole
    draw = random.Random(5)
    flipped_path = tmp_path / "flipped.mcap"
    for _ in range(FLIPS):
        flipped = bytearray(content)
        flipped[draw.randrange(200, end)] ^= 1 << draw.randrange(8)
        flipped_path.write_bytes(flipped)
        try:
            assert verify_log(flipped_path).damage not in ("", CUT)
            with LogReader(flipped_path) as log:
                for _, block in log.blocks():
                    assert np.array_equal(block.values, np.arange(block.first_sample, block.end_sample))
        except LogError:
            continue


@pytest.mark.parametrize("crashed", [False, True], ids=["with its summary", "without"])
@pytest.mark.parametrize("number", [0, 3])
@pytest.mark.parametrize("place", ["opcode", "length", "content", "length inside"])
def test_one_damaged_chunk_costs_only_itself(
    ramp: Path, tmp_path: Path, place: str, number: int, crashed: bool
) -> None:
    whole = bytearray(ramp.read_bytes()[: data_end(ramp) if crashed else None])
    begin, end = chunks_of(ramp)[number]
    at = {"opcode": 0, "length": 3, "content": (end - begin) // 2, "length inside": 52}[place]
    whole[begin + at] ^= 0x80
    (tmp_path / "damaged.mcap").write_bytes(whole)
    report = recover_log(tmp_path / "damaged.mcap", tmp_path / "recovered.mcap")
    assert report.sound
    assert report.lost == sum(topic.missing for topic in report.topics) == report.ledger_missing
    if place == "content" or (place == "length inside" and crashed):  # an index has a length of its own
        assert not report.whole
        assert 0 < report.lost <= 2 * 4 * BLOCK  # a chunk of at most 0.4 s of two channels
        with LogReader(tmp_path / "recovered.mcap") as log:
            assert {gap.cause for gap in log.gaps()} == {LOST}
    for topic in report.topics:
        if topic.topic.startswith("/measured"):
            assert topic.samples + topic.missing == 20 * BLOCK
    with LogReader(tmp_path / "recovered.mcap") as log:
        assert set(log.channels("measured")) == {"a", "b"}
        for _, block in log.blocks():
            assert np.array_equal(block.values, np.arange(block.first_sample, block.end_sample))


@pytest.mark.parametrize("crashed", [False, True], ids=["with its summary", "without"])
def test_a_channel_of_which_nothing_is_left_is_named(tmp_path: Path, crashed: bool) -> None:
    """Its only reading lay in the chunk that is damaged; what was finished says how many it had."""
    path = tmp_path / "log.mcap"
    with LogWriter(path) as writer:
        for name in ("a", "slow", "silent"):
            writer.declare("measured", Channel(name, "N"))
        writer.add_block("measured", block(0, "slow"), START_NS)
        for number in range(20):
            writer.add_block("measured", block(number), host_ns(block(number)))
    begin, end = chunks_of(path)[0]
    content = bytearray(path.read_bytes()[: data_end(path) if crashed else None])
    content[(begin + end) // 2] ^= 0x80
    path.write_bytes(content)
    report = recover_log(path, tmp_path / "recovered.mcap")
    assert report.sound
    assert not report.whole
    assert set(report.untold) == ({"/measured/slow", "/measured/silent"} if crashed else set())
    with LogReader(tmp_path / "recovered.mcap") as log:
        gaps = [(gap.channel, gap.first_sample, gap.count, gap.cause) for gap in log.gaps()]
    assert (("slow", 0, BLOCK, LOST) in gaps) != crashed


def test_verifying_reads_on_behind_a_damaged_chunk(ramp: Path, tmp_path: Path) -> None:
    content = bytearray(ramp.read_bytes())
    begin, end = chunks_of(ramp)[0]
    content[(begin + end) // 2] ^= 0x80
    (tmp_path / "log.mcap").write_bytes(content)
    report, whole = verify_log(tmp_path / "log.mcap"), verify_log(ramp)
    assert (report.sound, report.seconds) == (False, whole.seconds)
    assert "a chunk is damaged" in report.damage
    there, every = (sum(topic.samples for topic in each.topics) for each in (report, whole))
    assert 0 < there < every


def test_what_lay_at_the_end_of_a_finished_log_is_counted(ramp: Path, tmp_path: Path) -> None:
    content = bytearray(ramp.read_bytes())
    begin, end = chunks_of(ramp)[-1]
    content[(begin + end) // 2] ^= 0x80
    (tmp_path / "log.mcap").write_bytes(content)
    report = recover_log(tmp_path / "log.mcap", tmp_path / "recovered.mcap")
    whole = {topic.topic: topic.samples for topic in verify_log(ramp).topics}
    left = {topic.topic: topic.samples for topic in report.topics}
    assert report.lost == sum(whole.values()) - sum(left.values()) > 0
    assert (report.sound, report.whole, report.all_told) == (True, False, "samples")
    with LogReader(tmp_path / "recovered.mcap") as log:
        assert sum(gap.count for gap in log.gaps()) == report.lost


@pytest.mark.parametrize("change", [lambda log: log[:-1], lambda log: log + b"junk"], ids=["cut", "longer"])
def test_nothing_is_missing_where_only_what_comes_after_the_record_is_damaged(
    ramp: Path, tmp_path: Path, change: Callable[[bytes], bytes]
) -> None:
    (tmp_path / "log.mcap").write_bytes(change(ramp.read_bytes()))
    report = recover_log(tmp_path / "log.mcap", tmp_path / "recovered.mcap")
    assert (report.whole, report.lost) == (True, 0)
    assert [topic.samples for topic in report.topics] == [topic.samples for topic in verify_log(ramp).topics]


def test_a_flip_anywhere_in_a_crashed_log_is_told(ramp: Path, tmp_path: Path) -> None:
    """Also where no chunk's own checksum reaches: in its metadata, in the frame of its records."""
    whole = bytearray(ramp.read_bytes()[: chunks_of(ramp)[-1][0]])  # up to the last checksum but DataEnd's
    (tmp_path / "crashed.mcap").write_bytes(whole)
    with LogReader(tmp_path / "crashed.mcap") as log:
        assert log.damage == CUT
    begin = chunks_of(ramp)[0][0]
    rng = random.Random(5)
    # any bit of a record's head: its kind may become that of an end, of an index, of a message
    for at, bit in product(heads_of(bytes(whole)), range(8)):
        whole[at] ^= 1 << bit
        (tmp_path / "crashed.mcap").write_bytes(whole)
        with LogReader(tmp_path / "crashed.mcap") as log:
            assert log.damage not in ("", CUT), (at, bit)
        whole[at] ^= 1 << bit
    for at in (
        *range(begin + 60),
        *rng.sample(range(len(whole)), FLIPS),
        *range(len(whole) - 99, len(whole)),
    ):
        whole[at] ^= 1 << at % 8
        (tmp_path / "crashed.mcap").write_bytes(whole)
        with LogReader(tmp_path / "crashed.mcap") as log:
            assert log.damage not in ("", CUT), at
        whole[at] ^= 1 << at % 8


def test_a_flip_in_what_describes_a_finished_log_is_told_by_whoever_opens_it(
    ramp: Path, tmp_path: Path
) -> None:
    """A report, an overlay and a replay read no checksum of all the data."""
    path = tmp_path / "late.mcap"
    with LogWriter(path) as late:
        late.add_metadata("scenario", {"toml": 'amplitude = "9 N"'})
        late.declare("measured", Channel("a", "N"))
        late.add_block("measured", block(0), START_NS)
        late.add_metadata("run", {"id": "run-7"})  # into an open chunk
        late.add_block("measured", block(1), START_NS)
        late.flush_if_older(START_NS + NS_PER_S)
        late.add_metadata("twin", {"effects": "none"})
    with LogReader(path) as log:
        assert (log.complete, log.damage, log.library) == (True, "", "rattle")
        described = log.metadata
        assert set(described) == {"scenario", "run", "twin"}
    whole, places = bytearray(path.read_bytes()), [(0, chunks_of(path)[0][0])]
    places += [(end, end + 120) for _, end in chunks_of(path)]
    changed = 0
    for at, bit in product([at for begin, end in places for at in range(begin, end)], range(0, 8, 3)):
        whole[at] ^= 1 << bit
        path.write_bytes(whole)
        with LogReader(path) as log:
            assert log.metadata.items() <= described.items(), (at, bit)
            if log.metadata != described or not log.library.startswith("rattle"):
                changed += 1
                assert log.damage, (at, bit)
                assert not log.complete
        whole[at] ^= 1 << bit
    assert changed > 100


def test_every_chunk_can_be_read_alone(ramp: Path) -> None:
    content = ramp.read_bytes()
    assert len(chunks_of(ramp)) > 3
    for begin, end in chunks_of(ramp):
        alone = ramp.with_name(f"{begin}.mcap")
        alone.write_bytes(content[begin:end])
        with LogReader(alone) as log:
            assert log.damage == "it does not begin as an MCAP file does"
            for name in ("a", "b"):
                assert log.channels("measured")[name].unit == "N"
                assert len(log.series("measured", name).values) >= BLOCK


@pytest.mark.long
def test_a_flip_behind_the_data_is_no_sound_log(ramp: Path, tmp_path: Path) -> None:
    """In its index, summary or footer, bit by bit: what the samples are called, and where, stands there."""
    whole, begin = ramp.read_bytes(), data_end(ramp)
    flipped_path = tmp_path / "flipped.mcap"
    for at in range(begin, len(whole)):
        flipped = bytearray(whole)
        flipped[at] ^= 1 << at % 8
        flipped_path.write_bytes(flipped)
        assert not verify_log(flipped_path).sound, at
        with LogReader(flipped_path) as log:
            assert {name: each.unit for name, each in log.channels("measured").items()} == {
                "a": "N",
                "b": "N",
            }
            assert sum(len(block) for _, block in log.blocks()) == 2 * 20 * BLOCK


@pytest.mark.parametrize("cut", [0, 1, 40])
@pytest.mark.parametrize("crashed", [False, True])
def test_of_two_recordings_in_one_file_the_first_is_saved(tmp_path: Path, crashed: bool, cut: int) -> None:
    """As `cat` leaves them; the first finished or not, whole or short of some bytes."""
    first = write_ramp(tmp_path / "first.mcap", blocks=20)
    second = write_ramp(tmp_path / "second.mcap", blocks=30, scenario='name = "another"')
    whole = first.read_bytes()
    head = whole[: data_end(first)] if crashed else whole
    both = tmp_path / "both.mcap"
    both.write_bytes(head[: len(head) - cut] + second.read_bytes())
    assert not verify_log(both).sound
    report = recover_log(both, tmp_path / "recovered.mcap")
    assert report.sound
    assert not report.whole
    assert f"another log begins at byte {len(head) - cut}" in report.recovered_from
    with LogReader(first) as one, LogReader(tmp_path / "recovered.mcap") as saved:
        assert saved.scenario == 'name = "ramp"'
        for name in ("a", "b"):
            held = saved.series("measured", name).values
            kept = len(held) if crashed and cut else 20 * BLOCK  # its last chunk is damaged then
            assert kept >= 10 * BLOCK
            np.testing.assert_array_equal(held[:kept], one.series("measured", name).values[:kept])
            assert len(held) == kept


@pytest.mark.parametrize(
    ("gap", "unaccounted"),
    [
        (Gap(START_NS, "a", 100, 10, "x"), 0),
        (Gap(START_NS, "b", 100, 10, "x"), 10),
        (Gap(START_NS, "a", 100, 10, "x", "predicted"), 10),
        (Gap(START_NS, "a", 105, 10, "x"), 10),
        (Gap(START_NS, "a", 300, 50, "after the last"), 10),
        (Gap(START_NS, "a", 100, 10, "x", ""), 0),  # as logs of before have it
    ],
)
def test_only_a_gap_of_just_these_samples_accounts_for_them(
    tmp_path: Path, gap: Gap, unaccounted: int
) -> None:
    """A sum would take ten samples of one channel for those of another."""
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.declare("measured", Channel("a", "N"))
        before, after = block(0), replace(block(1), first_sample=110)
        log.add_block("measured", before, START_NS)
        log.add_gap(gap, START_NS)
        log.add_encoded_block("measured", after, encode_block(after), START_NS, record_gap=False)
    report = verify_log(path)
    assert sum(topic.unaccounted for topic in report.topics) == unaccounted
    assert report.sound == (unaccounted == 0)


def test_samples_that_come_twice_are_no_break_of_the_sequence(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.declare("measured", Channel("a", "N"))
        for again in (block(0), block(0), block(1)):
            log.add_message("/measured/a", encode_block(again), START_NS, START_NS)
    report = verify_log(path)
    (topic,) = report.topics
    assert (topic.repeats, topic.sequence_breaks, topic.unaccounted) == (1, 0, 0)
    assert not report.sound
    recovered = recover_log(path, tmp_path / "recovered.mcap")
    assert recovered.recovered_from.startswith("/measured/a: sample 0 comes twice")
    assert recovered.sound
    assert not recovered.whole
    with LogReader(tmp_path / "recovered.mcap") as saved:
        assert saved.series("measured", "a").end_sample == BLOCK


@pytest.mark.parametrize(
    ("of_chunks", "of_data", "unchecked"), [(False, False, 3), (True, False, 0), (False, True, 1)]
)
def test_a_log_of_others_without_checksums_is_unverified(
    tmp_path: Path, of_chunks: bool, of_data: bool, unchecked: int
) -> None:
    path = write_foreign(tmp_path / "log.mcap", of_chunks, of_data)
    report = verify_log(path)
    assert report.unchecked == unchecked
    assert report.unverified == (unchecked > 0)
    assert report.sound == (unchecked == 0)
    for name in ("recovered.mcap", "again.mcap"):  # a copy has checksums of what nobody could check
        copy = recover_log(path, path := tmp_path / name)
        assert (copy.unchecked, copy.unchecked_before) == (0, unchecked)
        assert (copy.sound, copy.unverified) == (unchecked == 0, unchecked > 0)


def test_chunks_that_no_index_has_are_read(tmp_path: Path) -> None:
    """Their statistics say how many there are."""
    path = write_foreign(tmp_path / "log.mcap", True, True, index=IndexType.NONE)
    report = recover_log(path, tmp_path / "recovered.mcap")
    assert report.sound
    assert [topic.samples for topic in report.topics] == [2 * BLOCK]


def test_a_recovery_that_is_broken_off_leaves_nothing_that_looks_whole(
    ramp: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []

    def interrupted(name: str, data: bytes) -> SampleBlock:
        seen.append(len(data))
        if len(seen) == 10:
            raise KeyboardInterrupt
        return decode_block(name, data)

    monkeypatch.setattr(recover, "decode_block", interrupted)
    with pytest.raises(KeyboardInterrupt):
        recover_log(ramp, tmp_path / "recovered.mcap")
    assert not (tmp_path / "recovered.mcap").exists()


@pytest.mark.parametrize("short", [100, 3000])
def test_a_recovery_for_which_the_disk_has_no_room_leaves_nothing_either(
    ramp: Path, tmp_path: Path, short: int
) -> None:
    """It would be one that was only cut, and nobody would know of the rest."""
    recovered = tmp_path / "recovered.mcap"
    with room_for(ramp.stat().st_size - short), pytest.raises(LogError, match="File too large"):
        recover_log(ramp, recovered)
    assert not recovered.exists()


@pytest.mark.parametrize("origin", ["measured", ""], ids=["with an origin", "as before"])
def test_gaps_that_follow_one_another_are_one_hole(tmp_path: Path, origin: str) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.declare("measured", Channel("a", "N"))
        log.add_block("measured", block(0), START_NS)
        log.add_gap(Gap(START_NS, "a", 100, 30, "lost on the bus", origin), START_NS)
        log.add_gap(Gap(START_NS, "a", 130, 70, "queue full", origin), START_NS)
        log.add_block("measured", block(2), START_NS)
    assert verify_log(path).sound
    report = recover_log(path, tmp_path / "again.mcap")
    assert (report.sound, report.whole, report.lost) == (True, True, 0)


def test_recovering_never_overwrites(ramp: Path, tmp_path: Path) -> None:
    (tmp_path / "there.mcap").write_bytes(b"mine")
    with pytest.raises(LogError, match="exists already"):
        recover_log(ramp, tmp_path / "there.mcap")
    assert (tmp_path / "there.mcap").read_bytes() == b"mine"


@pytest.mark.parametrize("claimed", [1 << 30, 1000], ids=["honest", "a lie"])
def test_a_zstd_bomb_is_refused_without_taking_memory(tmp_path: Path, claimed: int) -> None:
    compressor = zstandard.ZstdCompressor().compressobj()
    million = bytes(1 << 20)
    bomb = b"".join(compressor.compress(million) for _ in range(1024)) + compressor.flush()
    path = crashed_file(tmp_path / "bomb.mcap", Chunk("zstd", bomb, 1, 0, 0, claimed))
    tracemalloc.start()
    try:
        with pytest.raises(LogError, match=r"not a log .*(claims|holds)"):
            LogReader(path).open()
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("compression", "content", "words"),
    [
        ("lz4", b"abc", "its compression is 'lz4'"),
        ("", bytes(1000), "no record 0"),
        ("", b"\x05" + (1 << 40).to_bytes(8, "little"), "no record 5 of"),
        ("", b"\x05\x02" + bytes(7) + b"ab", "a message of 2 bytes"),
    ],
)
def test_a_chunk_of_nonsense_is_refused(tmp_path: Path, compression: str, content: bytes, words: str) -> None:
    path = crashed_file(tmp_path / "bad.mcap", Chunk(compression, content, 1, 0, 0, len(content)))
    with pytest.raises(LogError, match=f"not a log .*{words}"):
        LogReader(path).open()


@pytest.mark.parametrize("content", [b"", b"hello", bytes(5000)])
def test_what_is_no_log_is_called_that(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "no.mcap").write_bytes(content)
    with pytest.raises(LogError, match="not a log"):
        LogReader(tmp_path / "no.mcap").open()


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"gone.mcap: No such file"):
        LogReader(tmp_path / "gone.mcap").open()


@pytest.mark.parametrize("cut", [0, 40])
def test_a_chunk_of_ours_without_checksum_is_damaged(tmp_path: Path, cut: int) -> None:
    """0 is no mark that it was never checked: ours all are."""
    path = write_ramp(tmp_path / "log.mcap")
    with path.open("rb") as file:
        chunk = read_summary(file.fileno()).chunks[1]
    content = bytearray(path.read_bytes())
    content[chunk.start + 33 : chunk.start + 37] = bytes(4)
    path.write_bytes(content[: len(content) - cut])
    report = verify_log(path)
    assert not report.sound
    assert "damaged" in report.damage or "checksum" in report.damage
    recover_log(path, tmp_path / "recovered.mcap")
    with LogReader(tmp_path / "recovered.mcap") as log:
        assert {gap.cause for gap in log.gaps()} == {LOST}
