"""Reads logs, also those without summary (a crash), with every checksum verified."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cached_property, partial
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import IO, Final, Literal, NamedTuple, TypeVar, get_args

import numpy as np
import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel as ChannelRecord
from mcap.records import Chunk, Metadata
from mcap.writer import MCAP0_MAGIC

from daq.allowance import MOST_COLUMNS, MOST_DESCRIPTION_BYTES, Allowance
from daq.block import NS_PER_S, Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.errors import DAMAGED, LogError
from daq.log import codec
from daq.log.chunks import IndexedChunks, OpenedChunk, open_chunk
from daq.log.front import ANOTHER, check_data, library_of, metadata_and_chunks, read_summary
from daq.log.records import ENDS, RECORD_END, STOPPING, ClockRecord, Event, Gap, Impact

_Kind = TypeVar("_Kind", Event, Gap, ClockRecord, Impact)
Origin = Literal["measured", "nominal", "predicted/surrogate", "predicted", "derived"]
"""`nominal` is the twin without the effects that `predicted` has, only where it has any; the surrogate is
what was learnt from recordings, beside the twin; `derived` is what was computed from the samples of the
others while they were recorded. A topic is of the first of these that it begins with."""
SURROGATE: Final[Origin] = "predicted/surrogate"
_FOREIGN_ERRORS = (McapError, DecodeError, zstandard.ZstdError, struct.error, *DAMAGED)
"""What the MCAP, zstd and protobuf packages raise on damaged input."""

_LONGEST_SERIES = 1 << 29
"""Near three hours at 51.2 kHz."""
ROUNDING_S = 1e-6
CYCLE_PEAK, CYCLE_RMS = "cycle_peak", "cycle_rms"
CRANK_SPEED = "crank.speed"


def origin_and_name(topic: str) -> tuple[Origin | None, str]:
    """Whose samples a topic has, and of which channel; None of one that has none."""
    for origin in get_args(Origin):
        if topic.startswith(f"/{origin}/"):
            return origin, topic.removeprefix(f"/{origin}/")
    return None, topic


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
    also behind damage. `damage` says what was found wrong first, `damaged_at` from which byte on, if known;
    `whole_to_its_end` where only what comes behind all that was recorded is damaged. `ends` is what one that
    was finished says of where each topic of samples ends.
    `passing` hears up to which byte, about, messages have been read.
    """

    def __init__(self, path: Path, passing: Callable[[int], None] = lambda _: None) -> None:
        self.path, self.passing = path, passing
        self.complete = False
        self.damage = ""
        self.damaged_at: int | None = None
        self.ends: dict[str, str] = {}
        self.whole_to_its_end = False
        self.library = ""
        self.metadata: dict[str, dict[str, str]] = {}
        self._topics: dict[str, dict[str, str]] = {}
        self._channel_names: dict[int, str] = {}
        self._channel_records: dict[bytes, ChannelRecord] = {}
        self._described_bytes = 0
        self._indexed: IndexedChunks | None = None

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
            self.library = library_of(self._file.fileno())
            self._read_summary()
        except _FOREIGN_ERRORS:
            self._indexed = None
        try:
            if self._indexed is None:
                self._scan()
        except LogError:
            self.close()
            raise
        return self

    def close(self) -> None:
        if self._indexed is not None:
            self._indexed.close()
        self._file.close()

    @property
    def scenario(self) -> str:
        """The scenario's TOML text; empty if the log has none."""
        return self.metadata.get("scenario", {}).get("toml", "")

    def channels(self, origin: Origin) -> dict[str, Channel]:
        """Channels under /`origin`/, by name, in the order of declaration."""
        return {
            name: Channel.from_metadata(name, metadata)
            for topic, metadata in self._topics.items()
            for whose, name in [origin_and_name(topic)]
            if whose == origin
        }

    def allowance(self) -> Allowance:
        """What one who keeps what he reads of this log may still take."""
        return Allowance(self.path, self._file.fileno())

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
                chunk, channels = self._opened(opening)
            except LogError as error:
                if not skip_damaged:
                    raise
                self._note(str(error))
                continue
            names.update((channel.id, channel.topic) for channel in channels)
            for number, sequence, log_ns, publish_ns, start, end in chunk.messages():
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
        zero_ns: int | None = None,
        heard: Callable[[SampleBlock], None] = lambda _: None,
    ) -> dict[str, SampleBlock]:
        """Like `series`, for several channels (default: all) in one pass over the file.

        With `zero_ns`, the times count from there, not from each channel's own sample 0. `heard` gets every
        block that is in it. What comes behind the end of all channels is not read.
        """
        names = list(self.channels(origin)) if channels is None else list(channels)
        parts: dict[str, list[SampleBlock]] = {name: [] for name in names}
        spans: dict[str, tuple[float, float]] = {}
        allowance, unfinished = self.allowance(), set(names)
        for _, block in self.blocks(origin, names):
            if block.channel not in spans:
                late_s = 0.0 if zero_ns is None else late_by_s(block, zero_ns)
                until_s = math.inf if end_s is None else end_s - late_s
                spans[block.channel] = start_s - late_s if start_s > 0 else 0.0, until_s
            from_s, until_s = spans[block.channel]
            begin = block.first_sample / block.sample_rate
            if begin < until_s and block.end_sample / block.sample_rate > from_s:
                allowance.spend(held=block.values.nbytes, records=1)
                parts[block.channel].append(block)
                heard(block)
            elif begin >= until_s:
                unfinished.discard(block.channel)
                if not unfinished:
                    break
        return {
            name: _join(f"{self.path}: samples of /{origin}/{name}", blocks, spans.get(name), allowance)
            for name, blocks in parts.items()
        }

    def events(self) -> list[Event]:
        """All events in file order."""
        return self._all(Event, "/event")

    @cached_property
    def stopped_ns(self) -> int | None:
        """When a run was stopped before its record had ended: from then on it shows the way to rest."""
        ends = (event for event in self.events() if event.code in (RECORD_END, STOPPING))
        first = next(ends, None)
        return first.time_ns if first is not None and first.code == STOPPING else None

    @cached_property
    def zero_ns(self) -> int | None:
        """The start of recording: sample 0 of the first channel that was measured, else predicted and so on.

        None where there is no sample.
        """
        for origin in get_args(Origin):
            names = list(self.channels(origin))
            for chosen in filter(None, (names[:1], names)):
                for _, first in self.blocks(origin, chosen):
                    return sample_time_ns(first.time_ns, -first.first_sample, first.sample_rate)
        return None

    @cached_property
    def until_stop_s(self) -> float | None:
        """The same in s since the start of recording; None where all of it is as it was meant."""
        if self.stopped_ns is None or self.zero_ns is None:
            return None
        return max((self.stopped_ns - self.zero_ns) / NS_PER_S, 0.0)

    def end_s(self, origin: Origin, channel: str) -> float:
        """Seconds from sample 0 of a channel to its end: of a finished log only the last chunk is read."""
        topic = f"/{origin}/{channel}"
        last = deque(self.messages({topic}, start_ns=self.last_ns({topic: -1})[topic]), maxlen=1)
        blocks = (codec.decode_block(channel, message.data) for message in last)
        return max((block.end_sample / block.sample_rate for block in blocks), default=0.0)

    def gaps(self) -> list[Gap]:
        return self._all(Gap, "/gap")

    def clocks(self) -> list[ClockRecord]:
        return self._all(ClockRecord, "/clock")

    def impacts(self) -> list[Impact]:
        """The impacts that were found in the samples while they were recorded."""
        return self._all(Impact, "/impact")

    def _all(self, kind: type[_Kind], topic: str) -> list[_Kind]:
        found, allowance = [], self.allowance()
        for message in self.messages({topic}):
            allowance.spend(held=len(message.data), records=1)
            found.append(codec.decode_record(kind, message.data))
        return found

    def last_ns(self, after_ns: Mapping[str, int]) -> dict[str, int]:
        """When the host had the last of each topic at the latest, by those chunks that begin after its time.

        By the index, in one pass over it; 0 where there is none.
        """
        lasts = dict.fromkeys(after_ns, 0)
        if self._indexed is not None:
            names = {number: name for number, name in self._channel_names.items() if name in after_ns}
            found = self._indexed.last_ns({number: after_ns[name] for number, name in names.items()})
            for number, name in names.items():
                lasts[name] = max(lasts[name], found[number])
        return lasts

    def may_hold(self, topics: Collection[str]) -> list[str]:
        """Topics of which messages were written, by the index; without one they may have been of all."""
        lasts = self.last_ns(dict.fromkeys(topics, -1))
        return [topic for topic in topics if self._indexed is None or lasts[topic] > 0]

    def check_frame(self) -> int:
        """Read the whole file from its front and note in `damage` where its framing or checksum is wrong.

        And what of it is never read. Returns how many chunks no checksum covers; the summary counts as one.
        """
        indexed = None if self._indexed is None else len(self._indexed)
        return check_data(self._file.fileno(), self.allowance(), self._note, indexed)

    def _read_summary(self) -> None:
        summary = read_summary(self._file.fileno())
        for record in summary.declared:
            channel = self._channel(record)
            self._topics[channel.topic] = channel.metadata
            self._channel_names[channel.id] = channel.topic
        self.ends = summary.metadata.pop(ENDS, {})
        self.metadata = summary.metadata
        self._indexed = IndexedChunks(self._file.fileno(), summary.chunks, self.sealed)
        self.complete = True

    @property
    def sealed(self) -> bool:
        """Whether all its chunks were written with checksums."""
        return self.library.startswith("rattle")

    def _channel(self, record: bytes) -> ChannelRecord:
        """As declared; chunk by chunk the same again."""
        if record not in self._channel_records:
            self._described_bytes += len(record)
            if self._described_bytes > MOST_DESCRIPTION_BYTES or len(self._channel_records) == MOST_COLUMNS:
                raise LogError(f"{self.path}: it declares more than {MOST_COLUMNS} channels, or at length")
            channel = ChannelRecord.read(ReadDataStream(BytesIO(record)))
            try:
                Channel.from_metadata(channel.topic, channel.metadata)
            except LogError as error:
                self._note(f"{self.path}: {error}")
                del channel.metadata["scale"]
            self._channel_records[record] = channel
        return self._channel_records[record]

    def _scan(self) -> None:
        self._topics, self._channel_names, allowance = {}, {}, self.allowance()
        for record in metadata_and_chunks(self._file.fileno(), self.allowance(), self._note):
            if isinstance(record, Metadata):
                if record.name == ENDS:
                    self.ends, self.whole_to_its_end = record.metadata, not self.damage
                else:
                    self.metadata[record.name] = record.metadata
                continue
            try:
                _, channels = self._opened(partial(open_chunk, record, allowance, self.sealed))
            except LogError as error:
                self._note(str(error).removeprefix(f"{self.path}: "))
                continue
            for channel in channels:
                self._topics.setdefault(channel.topic, channel.metadata)
                self._channel_names[channel.id] = channel.topic
        if not self._topics and not self.metadata:
            foreign = "" if begins_as_log(self.path) else "it does not begin as an MCAP file does"
            raise LogError(f"{self.path}: not a log ({foreign or self.damage or 'it holds nothing'})")

    def _openings(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[Callable[[], OpenedChunk]]:
        """Chunks in file order, each to be opened by a call; without index all of them."""
        if self._indexed is None:
            allowance = self.allowance()
            passed = 0
            for record in metadata_and_chunks(self._file.fileno(), self.allowance(), self._note):
                if isinstance(record, Chunk):
                    self.passing(passed := passed + len(record.data))
                    yield partial(open_chunk, record, allowance, self.sealed)
            return
        numbers = None
        if topics is not None:
            numbers = frozenset(number for number, topic in self._channel_names.items() if topic in topics)
        for place, opening in self._indexed.passing(numbers, start_ns, end_ns, self.allowance()):
            self.passing(place)
            yield opening.result

    def _opened(self, opening: Callable[[], OpenedChunk]) -> tuple[OpenedChunk, list[ChannelRecord]]:
        """A chunk, and the channels that it declares."""
        try:
            chunk = opening()
            return chunk, [self._channel(record) for record in chunk.declared]
        except LogError:
            raise
        except _FOREIGN_ERRORS as error:
            what = f"{type(error).__name__}: {error}; rattle verify says where, rattle recover saves the rest"
            raise LogError(f"{self.path}: a chunk is damaged ({what})") from error

    def _note(self, damage: str, at: int | None = None) -> None:
        """What was found first says where it begins; what is left out as another log is told in any case."""
        if not self.damage:
            self.damage, self.damaged_at = damage, at
        elif damage.startswith(ANOTHER) and ANOTHER not in self.damage:
            self.damage += f"; {damage}"


def late_by_s(block: SampleBlock, zero_ns: int) -> float:
    """When a block's sample 0 was, counted from `zero_ns`; 0 where only rounding differs."""
    late_s = (block.time_ns - zero_ns) / NS_PER_S - block.first_sample / block.sample_rate
    return late_s if abs(late_s) > ROUNDING_S else 0.0


def _join(
    what: str, blocks: list[SampleBlock], span: tuple[float, float] | None, allowance: Allowance
) -> SampleBlock:
    if not blocks or span is None:
        raise LogError(f"{what}: none in the asked time")
    start_s, end_s = span
    rate = blocks[0].sample_rate
    first = max(min(block.first_sample for block in blocks), round(start_s * rate))
    end = max(block.end_sample for block in blocks)
    if end_s < math.inf:
        end = min(end, round(end_s * rate))
    if end - first > _LONGEST_SERIES:
        raise LogError(f"{what}: {end - first} from first to last are too many for one array")
    # from sample 0 on, where a prediction begins
    allowance.spend(held=max(end, 0) * blocks[0].values.itemsize)
    values = np.full(max(end - first, 0), np.nan, dtype=blocks[0].values.dtype)
    flags = Flag.GOOD
    for block in blocks:
        low, high = max(block.first_sample, first), min(block.end_sample, end)
        values[max(low - first, 0) : max(high - first, 0)] = block.values[
            low - block.first_sample : max(high, low) - block.first_sample
        ]
        flags |= block.flags
    origin_ns = blocks[0].time_ns - round(blocks[0].first_sample * NS_PER_S / rate)
    return SampleBlock(
        blocks[0].channel, first, origin_ns + round(first * NS_PER_S / rate), rate, values, flags
    )


def derived_name(origin: Origin, name: str, figure: str = "") -> str:
    """What was measured keeps its name, what was not says whose it is; `figure` is one of its cycles."""
    whose = name if origin == "measured" else f"{origin}.{name}"
    return f"{whose}.{figure}" if figure else whose
