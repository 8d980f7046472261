"""A run that has everything goes through every format and comes back sample by sample, to the nanosecond."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from daq.block import Flag, SampleBlock
from daq.errors import LogError, RattleError
from daq.formats import FORMATS, format_of
from daq.formats.contents import Contents
from daq.formats.recording import Recording, Stretch, TimeBase, Track, blocks_of, read_log, union, write_log
from daq.formats.samples import Scratch
from daq.log.reader import LogReader
from daq.log.recover import verify_log
from daq.log.writer import LogWriter
from tests.daq.formats import runs

WRITERS = [name for name, each in FORMATS.items() if each.write is not None]
EXACT = [name for name in WRITERS if name != "uff"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("formats")


@pytest.fixture(scope="module")
def scratch(folder: Path) -> Iterator[Scratch]:
    with Scratch(folder) as opened:
        yield opened


@pytest.fixture(scope="module")
def recording(folder: Path, scratch: Scratch) -> Recording:
    return runs.recorded(runs.write_run(folder / "run.mcap"), scratch)


@pytest.fixture(scope="module", params=WRITERS)
def exported(
    request: pytest.FixtureRequest, folder: Path, scratch: Scratch, recording: Recording
) -> tuple[str, list[str], Contents]:
    """Name of the format, what it warned of, and what its files hold."""
    chosen, warnings = FORMATS[request.param], list[str]()
    assert chosen.write is not None
    paths = chosen.write(recording, folder / f"run{chosen.suffixes[0]}", warnings.append)
    found = [format_of(path).read(path, scratch) for path in paths]
    columns = tuple(column for each in found for column in each.columns)
    impacts = [impact for each in found for impact in each.rest.impacts]
    return chosen.name, warnings, Contents(columns, dataclasses.replace(found[0].rest, impacts=impacts))


def test_samples_come_back_bit_by_bit_in_their_precision(
    exported: tuple[str, list[str], Contents], recording: Recording
) -> None:
    found = runs.by_name(exported[2])
    for track in recording.tracks:
        if track.stretches:
            assert found[track.name].samples.dtype == track.samples.dtype
            assert runs.real_bytes(found[track.name].samples, track) == runs.real_bytes(track.samples, track)


def test_time_and_index_come_back_exactly(
    exported: tuple[str, list[str], Contents], recording: Recording
) -> None:
    found = runs.by_name(exported[2])
    for track in (each for each in recording.tracks if each.stretches):
        stretches = found[track.name].stretches
        assert stretches is not None
        assert stretches[0].time_ns == track.stretches[0].time_ns
        assert stretches[0].first_sample == track.first_sample
        assert {each.base.sample_rate for each in stretches} == {track.stretches[0].base.sample_rate}
        assert union(each.flags for each in stretches) == track.flags
        if exported[0] in EXACT:
            assert stretches == track.stretches


def test_gaps_stay_gaps(exported: tuple[str, list[str], Contents], recording: Recording) -> None:
    force = runs.by_name(exported[2])["measured/contact.force_upper"]
    assert force.stretches is not None
    missing = set(range(51_200)) - {
        at for each in force.stretches for at in range(each.first_sample, each.end_sample)
    }
    assert missing == set(range(4 * 5120, 5 * 5120))
    assert np.isnan(runs.everything(force.samples)[4 * 5120 : 5 * 5120]).all()


def test_channels_keep_what_they_are(exported: tuple[str, list[str], Contents], recording: Recording) -> None:
    found = runs.by_name(exported[2])
    for track in (each for each in recording.tracks if each.stretches):
        column = found[track.name]
        assert {"unit": column.unit, **column.details} == track.channel.metadata()


def test_events_clocks_and_records_come_back_or_are_warned_of(
    exported: tuple[str, list[str], Contents], recording: Recording
) -> None:
    name, warnings, contents = exported
    if name not in EXACT:
        assert any("no events, clock records" in each and "scenario" in each for each in warnings)
        return
    assert not warnings
    assert contents.rest.metadata == recording.metadata
    assert contents.rest.events == [runs.EVENT]
    assert contents.rest.gaps == recording.gaps
    (clock,) = contents.rest.clocks
    assert math.isnan(clock.uncertainty_s)
    assert dataclasses.replace(clock, uncertainty_s=0.0) == dataclasses.replace(runs.CLOCK, uncertainty_s=0.0)


def test_impacts_come_back_exactly_or_are_warned_of(exported: tuple[str, list[str], Contents]) -> None:
    name, warnings, contents = exported
    if name in EXACT:
        assert repr(contents.rest.impacts) == repr(runs.IMPACTS)  # NaN is not equal to itself
    else:
        assert not contents.rest.impacts
        assert "uff holds no impacts: 2 of /impact left out" in warnings


def test_a_channel_without_samples_comes_back_or_is_warned_of(
    exported: tuple[str, list[str], Contents],
) -> None:
    name, warnings, contents = exported
    if name in EXACT:
        assert runs.by_name(contents)["measured/drive.force"].stretches == ()
    else:
        assert any("measured/drive.force left out" in each for each in warnings)


def test_the_log_of_a_recording_is_the_log_it_was_read_from(folder: Path, recording: Recording) -> None:
    again = folder / "again.mcap"
    with LogWriter(again) as writer:
        write_log(recording, writer)
    assert verify_log(again).sound
    with LogReader(folder / "run.mcap") as one, LogReader(again) as two:
        assert two.metadata == one.metadata
        assert two.topic_metadata() == one.topic_metadata()
        assert two.events() == one.events()
        assert repr(two.impacts()) == repr(one.impacts()) == repr(runs.IMPACTS)
        assert sorted(two.gaps(), key=str) == sorted(one.gaps(), key=str)
        blocks = [sorted(log.blocks(), key=_place) for log in (one, two)]
        for (origin, block), (found_origin, found) in zip(*blocks, strict=True):
            flags = block.flags if np.isfinite(block.values).all() else block.flags | Flag.NOT_FINITE
            assert (found_origin, found.first_sample) == (origin, block.first_sample)
            # counted from a first sample whose own time was rounded
            assert abs(found.time_ns - block.time_ns) <= 1
            assert (found.sample_rate, found.flags) == (block.sample_rate, flags)
            assert found.values.tobytes() == block.values.tobytes()
        times = [message.log_ns for message in two.messages()]
    assert times == sorted(times)


def _place(entry: tuple[str, SampleBlock]) -> tuple[str, str, int]:
    return entry[0], entry[1].channel, entry[1].first_sample


def test_a_clock_that_was_set_anew_is_kept_or_warned_of(tmp_path: Path) -> None:
    blocks = runs.cut(runs.BASE, np.arange(300, dtype=np.float32), runs.SLOW)
    late = dataclasses.replace(blocks[2], time_ns=blocks[2].time_ns + 2_000_000, sample_rate=999.5)
    with LogWriter(tmp_path / "run.mcap") as log:
        log.declare("measured", runs.BASE)
        for block in (*blocks[:2], late):
            log.add_block("measured", block, block.time_ns)
    with Scratch(tmp_path) as scratch:
        recording = runs.recorded(tmp_path / "run.mcap", scratch)
        assert [(each.first_sample, each.time_ns) for each in recording.tracks[0].stretches] == [
            (0, runs.START_NS),
            (200, late.time_ns),
        ]
        for name in WRITERS:
            warnings: list[str] = []
            write = FORMATS[name].write
            assert write is not None
            (path,) = write(recording, tmp_path / f"run.{name}", warnings.append)
            (column,) = FORMATS[name].read(path, scratch).columns
            assert column.stretches is not None
            assert [(each.time_ns, each.base.sample_rate) for each in column.stretches] == [
                (runs.START_NS, runs.SLOW),
                (late.time_ns, 999.5),
            ]
            assert any("off the start and rate of its first sample" in each for each in warnings) == (
                name != "uff"
            )


def test_a_time_rounded_down_by_another_program_is_on_the_same_base(tmp_path: Path) -> None:
    blocks = runs.cut(runs.FORCE, np.zeros(12 * 1000, np.float32), 3e4)
    floored = [
        dataclasses.replace(each, time_ns=runs.START_NS + each.first_sample * 10**9 // 30_000)
        for each in blocks
    ]
    with LogWriter(tmp_path / "run.mcap") as log:
        log.declare("measured", runs.FORCE)
        for block in floored:
            log.add_block("measured", block, block.time_ns)
    with Scratch(tmp_path) as scratch, LogReader(tmp_path / "run.mcap") as log_reader:
        (track,) = read_log(log_reader, scratch).tracks
        assert len(track.stretches) == 1
        times = [block.time_ns for block in blocks_of(track)]
    assert max(abs(a - b.time_ns) for a, b in zip(times, floored, strict=True)) <= 1


@pytest.mark.parametrize("name", WRITERS)
def test_no_file_is_overwritten_and_none_left_half(
    name: str, tmp_path: Path, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, ending = FORMATS[name].write, FORMATS[name].suffixes[0]
    assert write is not None
    single = Recording(recording.tracks[:1])
    (tmp_path / f"there{ending}").write_bytes(b"mine")
    with pytest.raises(RattleError, match="exists already; name another file"):
        write(single, tmp_path / f"there{ending}", str)
    assert (tmp_path / f"there{ending}").read_bytes() == b"mine"
    with pytest.raises(RattleError, match=r"cannot create .*No such file"):
        write(single, tmp_path / "gone" / f"new{ending}", str)
    broken = dataclasses.replace(recording.tracks[0], samples=Unreadable(len(recording.tracks[0].samples)))
    with pytest.raises(LogError, match="the disk is gone"):
        write(Recording((broken,)), tmp_path / f"new{ending}", str)
    assert not (tmp_path / f"new{ending}").exists()


@dataclasses.dataclass(frozen=True)
class Unreadable:
    """Samples of a disk that is gone."""

    count: int

    @property
    def dtype(self) -> np.dtype[np.float32]:
        return np.dtype(np.float32)

    def __len__(self) -> int:
        return self.count

    def read(self, start: int, stop: int) -> np.ndarray:
        raise LogError("the disk is gone")


def test_a_channel_too_long_for_mat_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    count = 1 << 29
    base = TimeBase(0, runs.START_NS, 51_200.0)
    track = Track("measured", runs.FORCE, (Stretch(0, count, base),), Unreadable(count))
    write = FORMATS["mat"].write
    assert write is not None
    with pytest.raises(RattleError, match=r"measured/contact.force_upper: more than the 2 GB"):
        write(Recording((track,)), tmp_path / "run.mat", str)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["csv", "parquet"])
def test_a_table_without_a_sample_is_refused(name: str, tmp_path: Path) -> None:
    write = FORMATS[name].write
    assert write is not None
    with pytest.raises(RattleError, match="no sample in it"):
        write(Recording(()), tmp_path / "run.csv", str)


def test_the_ending_tells_the_format() -> None:
    assert format_of(Path("a.UNV")).name == "uff"
    with pytest.raises(LogError, match=r"run.xlsx: which format .* known are \.uff"):
        format_of(Path("run.xlsx"))
