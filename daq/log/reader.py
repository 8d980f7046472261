"""Reads logs, also those without summary (a crash), with every checksum verified."""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import IO, Literal, NamedTuple, get_args

import numpy as np
import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Chunk, Metadata
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from daq.block import NS_PER_S, Flag, SampleBlock
from daq.channel import Channel
from daq.errors import LogError
from daq.log import codec
from daq.log.chunks import IndexedChunks, OpenedChunk, open_chunk
from daq.log.front import check_data, check_summary, metadata_and_chunks
from daq.log.records import ClockRecord, Event, Gap, Impact

Origin = Literal["measured", "nominal", "predicted", "derived"]
"""`nominal` is the twin without the effects that `predicted` has, only where it has any; `derived` is what
was computed from the samples of the others while they were recorded."""
_FOREIGN_ERRORS = (
    McapError,
    DecodeError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    KeyError,
    OverflowError,
    MemoryError,
    OSError,
    EOFError,
)
"""What the MCAP, zstd and protobuf packages raise on damaged input."""

_LONGEST_SERIES = 1 << 29
"""Near three hours at 51.2 kHz; a damaged or hostile sample index must not take all memory."""
CYCLE_PEAK, CYCLE_RMS = "cycle_peak", "cycle_rms"
CRANK_SPEED = "crank.speed"


def begins_as_log(path: Path) -> bool:
    """Whether a file can be read and begins as every MCAP file does."""
    try:
        with path.open("rb") as file:
            return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC
    except (OSError, ValueError):
        return False


class LoggedMessage(NamedTuple):
    """One message as it stands in the file."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


class LogReader:
    """A log opened for reading.

    `complete` is False where the writer never finished: then the file is read from its front, chunk by chunk,
    also behind damage. `damage` says what was found wrong first.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.complete = False
        self.damage = ""
        self.library = ""
        self.metadata: dict[str, dict[str, str]] = {}
        self._topics: dict[str, dict[str, str]] = {}
        self._channel_names: dict[int, str] = {}
        self._summary: Summary | None = None

    def __enter__(self) -> LogReader:
        return self.open()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def open(self) -> LogReader:
        """Open the file and read what describes it; raises LogError if it is no MCAP file at all."""
        try:
            self._file: IO[bytes] = self.path.open("rb")
        except IsADirectoryError as error:
            raise LogError(f"{self.path}: a folder; name a log in it") from error
        except OSError as error:
            raise LogError(f"{self.path}: {error.strerror}") from error
        try:
            self._read_summary()
        except _FOREIGN_ERRORS:
            self._summary = None
        try:
            if self._summary is None:
                self._scan()
        except LogError:
            self.close()
            raise
        return self

    def close(self) -> None:
        if self._summary is not None:
            self._indexed.close()
        self._file.close()

    @property
    def scenario(self) -> str:
        """The scenario's TOML text; empty if the log has none."""
        return self.metadata.get("scenario", {}).get("toml", "")

    def channels(self, origin: Origin) -> dict[str, Channel]:
        """Channels under /`origin`/, by name, in the order of declaration."""
        prefix = f"/{origin}/"
        return {
            topic.removeprefix(prefix): Channel.from_metadata(topic.removeprefix(prefix), metadata)
            for topic, metadata in self._topics.items()
            if topic.startswith(prefix)
        }

    def topic_metadata(self) -> dict[str, dict[str, str]]:
        """Every topic of the file with its channel metadata."""
        return dict(self._topics)

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        skip_damaged: bool = False,
    ) -> Iterator[LoggedMessage]:
        """Messages in file order; `start_ns`, `end_ns` choose whole chunks by log time.

        Raises LogError at a damaged chunk, or passes over it and notes it in `damage` with `skip_damaged`.
        """
        names = dict(self._channel_names)
        for opening in self._openings(topics, start_ns, end_ns):
            try:
                chunk = self._opened(opening)
            except LogError as error:
                if not skip_damaged:
                    raise
                self._note(str(error))
                continue
            names.update((channel.id, channel.topic) for channel in chunk.channels)
            for number, sequence, log_ns, publish_ns, start, end in chunk.places:
                topic = names.get(number, "")
                if topics is None or topic in topics:
                    yield LoggedMessage(topic, log_ns, publish_ns, sequence, chunk.data[start:end])

    def blocks(
        self, origins: Origin | tuple[Origin, ...] | None = None, channels: Collection[str] | None = None
    ) -> Iterator[tuple[Origin, SampleBlock]]:
        """Sample blocks with their origin (default: of all), in file order (as they were recorded)."""
        if origins is None:
            origins = get_args(Origin)
        elif isinstance(origins, str):
            origins = (origins,)
        wanted: dict[str, tuple[Origin, str]] = {
            f"/{each}/{name}": (each, name)
            for each in origins
            for name in self.channels(each)
            if channels is None or name in channels
        }
        for message in self.messages(set(wanted)):
            found_origin, name = wanted[message.topic]
            yield found_origin, codec.decode_block(name, message.data)

    def series(
        self, origin: Origin, channel: str, start_s: float = 0.0, end_s: float | None = None
    ) -> SampleBlock:
        """All samples of a channel between `start_s` and `end_s` (seconds since sample 0) as one block.

        Missing samples are NaN and SAMPLES_MISSING_BEFORE is set. Raises LogError if there is none.
        """
        return self.table(origin, [channel], start_s, end_s)[channel]

    def table(
        self,
        origin: Origin,
        channels: Collection[str] | None = None,
        start_s: float = 0.0,
        end_s: float | None = None,
    ) -> dict[str, SampleBlock]:
        """Like `series`, for several channels (default: all) in one pass over the file."""
        names = list(self.channels(origin)) if channels is None else list(channels)
        parts: dict[str, list[SampleBlock]] = {name: [] for name in names}
        for _, block in self.blocks(origin, names):
            begin = block.first_sample / block.sample_rate
            if (end_s is None or begin < end_s) and block.end_sample / block.sample_rate > start_s:
                parts[block.channel].append(block)
        return {
            name: _join(self.path, origin, name, blocks, start_s, end_s) for name, blocks in parts.items()
        }

    def events(self) -> list[Event]:
        """All events in file order."""
        return [codec.decode_record(Event, message.data) for message in self.messages({"/event"})]

    def gaps(self) -> list[Gap]:
        return [codec.decode_record(Gap, message.data) for message in self.messages({"/gap"})]

    def clocks(self) -> list[ClockRecord]:
        return [codec.decode_record(ClockRecord, message.data) for message in self.messages({"/clock"})]

    def impacts(self) -> list[Impact]:
        """The impacts that were found in the samples while they were recorded."""
        return [codec.decode_record(Impact, message.data) for message in self.messages({"/impact"})]

    def check_frame(self) -> None:
        """Read the whole file from its front and note in `damage` where its framing or checksum is wrong."""
        check_data(self._file.fileno(), self._note)

    def _read_summary(self) -> None:
        check_summary(self._file.fileno())
        reader = SeekingReader(self._file, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None:
            return
        says_it_is_empty = summary.statistics is not None and summary.statistics.channel_count == 0
        if not summary.channels and not says_it_is_empty:
            return
        self.library = reader.get_header().library
        self._topics = {channel.topic: channel.metadata for channel in summary.channels.values()}
        self._channel_names = {number: channel.topic for number, channel in summary.channels.items()}
        self.metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        self._indexed = IndexedChunks(self._file.fileno(), summary.chunk_indexes)
        self._summary, self.complete = summary, True

    def _scan(self) -> None:
        for record in metadata_and_chunks(self._file.fileno(), self._note):
            if isinstance(record, Metadata):
                self.metadata[record.name] = record.metadata
                continue
            try:
                chunk = self._opened(partial(open_chunk, record))
            except LogError as error:
                self._note(str(error).removeprefix(f"{self.path}: "))
                continue
            for channel in chunk.channels:
                self._topics.setdefault(channel.topic, channel.metadata)
                self._channel_names[channel.id] = channel.topic
        if not self._topics and not self.metadata:
            foreign = "" if begins_as_log(self.path) else "it does not begin as an MCAP file does"
            raise LogError(f"{self.path}: not a log ({foreign or self.damage or 'it holds nothing'})")

    def _openings(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[Callable[[], OpenedChunk]]:
        """Chunks in file order, each to be opened by a call; without index all of them."""
        if self._summary is None:
            for record in metadata_and_chunks(self._file.fileno(), self._note):
                if isinstance(record, Chunk):
                    yield partial(open_chunk, record)
            return
        numbers = None
        if topics is not None:
            found = self._summary.channels.items()
            numbers = frozenset(number for number, channel in found if channel.topic in topics)
        for _, opening in self._indexed.passing(numbers, start_ns, end_ns):
            yield opening.result

    def _opened(self, opening: Callable[[], OpenedChunk]) -> OpenedChunk:
        try:
            return opening()
        except _FOREIGN_ERRORS as error:
            raise LogError(f"{self.path}: a chunk is damaged ({type(error).__name__}: {error})") from error

    def _note(self, damage: str) -> None:
        """What was found first says where it begins."""
        self.damage = self.damage or damage


def _join(
    path: Path, origin: str, name: str, blocks: list[SampleBlock], start_s: float, end_s: float | None
) -> SampleBlock:
    if not blocks:
        raise LogError(f"{path}: no samples of /{origin}/{name} in the asked time")
    rate = blocks[0].sample_rate
    first = max(min(block.first_sample for block in blocks), round(start_s * rate))
    end = max(block.end_sample for block in blocks)
    if end_s is not None:
        end = min(end, round(end_s * rate))
    if end - first > _LONGEST_SERIES:
        raise LogError(f"{path}: /{origin}/{name} spans {end - first} samples, too many for one array")
    values = np.full(max(end - first, 0), np.nan, dtype=blocks[0].values.dtype)
    flags = Flag.GOOD
    for block in blocks:
        low, high = max(block.first_sample, first), min(block.end_sample, end)
        values[max(low - first, 0) : max(high - first, 0)] = block.values[
            low - block.first_sample : max(high, low) - block.first_sample
        ]
        flags |= block.flags
    origin_ns = blocks[0].time_ns - round(blocks[0].first_sample * NS_PER_S / rate)
    return SampleBlock(name, first, origin_ns + round(first * NS_PER_S / rate), rate, values, flags)


def derived_name(origin: Origin, name: str, figure: str = "") -> str:
    """What was measured keeps its name, what was not says whose it is; `figure` is one of its cycles."""
    whose = name if origin == "measured" else f"{origin}.{name}"
    return f"{whose}.{figure}" if figure else whose
