"""Writes a run's log; after the first failed write it accepts nothing more."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from types import TracebackType
from typing import IO

from mcap.data_stream import RecordBuilder
from mcap.records import Channel as ChannelRecord
from mcap.records import ChunkIndex
from mcap.records import Schema as SchemaRecord
from mcap.writer import CompressionType, Writer

from daq.block import LATEST, NS_PER_S, Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.disk import sync_folder
from daq.errors import RecorderFailed
from daq.log import codec
from daq.log.codec import embedded_schema
from daq.log.records import CHECKSUM_OPCODE, ENDS, ClockRecord, Event, Gap, Impact

QUIET_S = 0.02  # nothing comes for so long once a block of every channel has
CHUNK_S, _APART_S = 0.15, 0.09
"""A chunk ends with the first message after so long (the format has 0.25 s at most), and in quiet, though not
sooner than that after the last that ended by time: each declares all channels anew. A crash costs what the
last one holds.
"""
_CHUNK_BYTES = 1 << 20
_NEVER_BY_ITSELF = 1 << 62
"""The package ends no chunk: who ends it has to open the next with its declarations."""


class LogWriter:
    """One MCAP file: channels are declared, then blocks, events, gaps and clocks added in any order.

    Sample indices are accounted for per topic: a block that starts later than the last one ended leaves a
    `Gap` in the log, one that starts earlier is refused. Each chunk declares all channels anew, so that it
    can be read where all others are lost. Not thread-safe but for `sync`: one thread owns a writer.
    """

    def __init__(
        self,
        path: Path,
        library: str = "rattle",
        opened: Callable[[Path], IO[bytes]] = lambda path: path.open("xb"),
    ) -> None:
        self.path, self._opened = path, opened
        self._library = library
        self._next_sample: dict[str, int] = {}
        self._sequence: dict[str, int] = {}
        self._topics: dict[str, int] = {}
        self._told_gaps: dict[str, list[tuple[int, int]]] = {}  # first sample and end, of what may come yet
        self._placed: dict[str, tuple[int, int, float]] = {}
        self._due: dict[tuple[str, str], tuple[int, int, str]] = {}
        self._schemas: dict[str, int] = {}
        self._chunk_opened_ns = self._ended_ns = 0
        self._declarations = bytearray()
        self._folder_synced = False
        self._failed: Exception | None = None
        self._open = False

    def open(self) -> LogWriter:
        """Create the file; refuses to overwrite one, and leaves none that could not be begun."""
        try:
            self._file = self._opened(self.path)
        except FileExistsError as error:
            raise RecorderFailed(f"{self.path} exists already; name another file") from error
        except OSError as error:
            raise RecorderFailed(f"cannot create {self.path}: {error}") from error
        try:
            self._indexes = _Indexes(self.path.parent)
        except OSError as error:
            self._file.close()
            self.path.unlink(missing_ok=True)
            raise RecorderFailed(f"cannot write in {self.path.parent}: {error}") from error
        self._writer = Writer(
            self._file, chunk_size=_NEVER_BY_ITSELF, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._open = True
        try:
            self._writer._Writer__chunk_indices = self._indexes  # type: ignore[attr-defined]
            self._guard(lambda: self._writer.start(profile="", library=self._library))
            self._seal()
        except RecorderFailed:
            self.close()
            self.path.unlink(missing_ok=True)
            raise
        return self

    def __enter__(self) -> LogWriter:
        return self.open()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def declare(self, origin: str, channel: Channel) -> None:
        """Register /`origin`/`channel.name`, so that it is in the file even if no sample ever comes."""
        self.register(f"/{origin}/{channel.name}", "SampleBlock", channel.metadata())

    def add_metadata(self, name: str, record: Mapping[str, str]) -> None:
        """Add a metadata record (`scenario`, `run`)."""
        self._guard(lambda: self._writer.add_metadata(name, dict(record)))
        self._seal()

    def add_block(self, origin: str, block: SampleBlock, host_ns: int) -> None:
        """Add samples of a declared channel; `host_ns` is when the host had them (Unix epoch)."""
        self.add_encoded_block(origin, block, codec.encode_block(block), host_ns)

    def add_encoded_block(
        self,
        origin: str,
        block: SampleBlock,
        data: bytes,
        host_ns: int,
        record_gap: bool = True,
        cause: str = "",
    ) -> int:
        """Add a block as it stands in another log; `record_gap` is False where its ledger is copied too.

        Returns how many samples are missing before it of which no gap told; `cause` says why, if it is known.
        """
        topic = f"/{origin}/{block.channel}"
        expected = self._next_sample.get(topic, 0)
        if self.comes_again(topic, block):
            raise RecorderFailed(f"{topic}: sample {block.first_sample} comes twice (next is {expected})")
        self._placed[topic] = block.first_sample, block.time_ns, block.sample_rate
        untold = self._untold(topic, block.first_sample) if record_gap else []
        if not cause and expected == 0:
            cause = "start of stream"
        elif not cause:
            flagged = block.flags & Flag.SAMPLES_MISSING_BEFORE
            cause = "samples missing" if flagged else "not flagged by the source"
        for first, end in untold:
            self._gap(origin, block.channel, first, end - first, cause, host_ns)
        self.add_message(topic, data, host_ns, block.time_ns)
        self._next_sample[topic] = block.end_sample
        return sum(end - first for first, end in untold)

    def comes_again(self, topic: str, block: SampleBlock) -> bool:
        """Whether samples of a block have come already."""
        return block.first_sample < self._next_sample.get(topic, 0)

    def add_event(self, event: Event) -> None:
        self._record("/event", "Event", event, event.time_ns)

    def add_gap(self, gap: Gap, host_ns: int) -> None:
        """Add an entry of the gap ledger; one that is added before the block after it gets no second."""
        topic = f"/{gap.origin or 'measured'}/{gap.channel}"
        self._told_gaps.setdefault(topic, []).append((gap.first_sample, gap.first_sample + gap.count))
        self._record("/gap", "Gap", gap, host_ns)

    def due(self, origin: str, channel: str, end_sample: int, time_ns: int, cause: str) -> None:
        """Samples of a declared channel up to `end_sample` were to come by `time_ns`.

        What of them is not there, and in no gap, when the log is closed is a gap at its end.
        """
        if f"/{origin}/{channel}" in self._topics:
            self._due[origin, channel] = end_sample, time_ns, cause

    def add_clock(self, clock: ClockRecord) -> None:
        self._record("/clock", "Clock", clock, clock.time_ns)

    def add_impact(self, impact: Impact, host_ns: int) -> None:
        self._record("/impact", "Impact", impact, host_ns)

    def flush_if_older(self, host_ns: int, quiet: bool = False) -> None:
        """End the chunk if it is time; to be called every 0.02 s while nothing comes, `quiet`."""
        if not self._chunk_opened_ns:
            return
        since_ns, least_s = (self._ended_ns, _APART_S) if quiet else (self._chunk_opened_ns, CHUNK_S)
        if not 0 <= host_ns - since_ns < least_s * NS_PER_S:  # negative: the host's clock was set back
            self._end_chunk()
            self._ended_ns = host_ns

    def sync(self) -> None:
        """Bring to the disk what the system has of the file, and the first time its name; from any thread.

        May take as long as the disk stalls. Raises RecorderFailed if the disk does not take it: then nobody
        knows what of the file it has, though it may say of the next sync that all is well.
        """
        try:
            os.fdatasync(self._file.fileno())
            if not self._folder_synced:
                sync_folder(self.path.parent)
                self._folder_synced = True
        except OSError as error:
            self._failed = error
            raise RecorderFailed(f"{self.path}: {error}; the log is readable up to here") from error

    def abandon(self, why: Exception) -> None:
        """Write what came before and leave the file unfinished: it lacks what was to be written now."""
        with suppress(Exception):  # where a write has failed, nothing more can be
            self._end_chunk()
        self._failed = self._failed or why

    def close(self) -> None:
        """Finish and sync the file. After a failed write it stays as it is: readable up to the last chunk."""
        if not self._open:
            return
        self._open = False
        try:
            if self._failed is None:
                self._close_tails()
                self._end_chunk()
                self.add_metadata(ENDS, {topic: str(end) for topic, end in self._next_sample.items()})
                self.sync()  # what says that the log is whole comes when all of it is there
                self._writer.finish()
                self._file.flush()
                self.sync()
                self._file.close()
        except RecorderFailed:  # an OSError too, which has said all
            raise
        except OSError as error:
            raise RecorderFailed(f"{self.path}: {error}") from error
        finally:
            for each in (self._indexes, self._file):
                with suppress(OSError):  # what a failed write left in a buffer fails once more, and is told
                    each.close()

    def _close_tails(self) -> None:
        for (origin, channel), (end, time_ns, cause) in self._due.items():
            for first, until in self._untold(f"/{origin}/{channel}", end):
                self._gap(origin, channel, first, until - first, cause, time_ns)

    def _gap(self, origin: str, channel: str, first: int, count: int, cause: str, host_ns: int) -> None:
        placed, time_ns, rate = self._placed.get(f"/{origin}/{channel}", (first, host_ns, 1.0))
        time_ns = min(max(sample_time_ns(time_ns, first - placed, rate), 0), LATEST - 1)
        self._record("/gap", "Gap", Gap(time_ns, channel, first, count, cause, origin), host_ns)

    def _untold(self, topic: str, end: int) -> list[tuple[int, int]]:
        """What of a topic's samples up to `end` has not come and stands in no gap: first and end of each."""
        first, untold = self._next_sample.get(topic, 0), list[tuple[int, int]]()
        told = self._told_gaps.pop(topic, [])
        if later := [each for each in told if each[1] > end]:
            self._told_gaps[topic] = later
        for begin, until in sorted(told):
            if first < min(begin, end):
                untold.append((first, min(begin, end)))
            first = max(first, until)
        return [*untold, (first, end)] if first < end else untold

    def register(self, topic: str, schema: str, metadata: dict[str, str]) -> None:
        """Declare a topic of the format by the name of its schema (`SampleBlock`, `Event` ...)."""
        if topic in self._topics:
            return
        if schema not in self._schemas:
            name, data = f"rattle.{schema}", embedded_schema(schema)
            number = self._schemas[schema] = self._writer.register_schema(name, "protobuf", data)
            self._keep(SchemaRecord(number, data, "protobuf", name))
        schema_id = self._schemas[schema]
        number = self._topics[topic] = self._writer.register_channel(topic, "protobuf", schema_id, metadata)
        self._keep(ChannelRecord(number, topic, "protobuf", metadata, schema_id))

    def _record(
        self, topic: str, schema: str, record: Event | Gap | ClockRecord | Impact, host_ns: int
    ) -> None:
        self.register(topic, schema, {})
        self.add_message(topic, codec.encode_record(record), host_ns, record.time_ns)

    def _keep(self, declaration: ChannelRecord | SchemaRecord) -> None:
        record = RecordBuilder()
        declaration.write(record)
        self._declarations += record.end()

    def add_message(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Add a message of a declared topic as it stands in another log."""
        self.flush_if_older(log_ns)
        sequence = self._sequence.get(topic, 0)
        self._sequence[topic] = sequence + 1
        if not self._chunk_opened_ns:
            self._chunk_opened_ns = log_ns
            if self._chunk.count < len(self._declarations):  # the first chunk has them as they were made
                self._chunk.write(self._declarations)
        self._guard(
            lambda: self._writer.add_message(
                self._topics[topic],
                log_time=log_ns,
                data=data,
                publish_time=max(publish_ns, 0),  # MCAP knows no time before 1970
                sequence=sequence,
            )
        )
        if self._chunk.count >= _CHUNK_BYTES:
            self._end_chunk()

    @property
    def _chunk(self) -> RecordBuilder:
        """The records of the chunk; the package has no call to add any but messages to it."""
        return self._writer._Writer__chunk_builder.record_writer  # type: ignore[attr-defined, no-any-return]

    def _end_chunk(self) -> None:
        self._guard(self._writer.flush)
        self._seal()
        self._chunk_opened_ns = 0

    def _seal(self) -> None:
        """A checksum of all so far, which goes to the system, so that it outlives this process.

        Between two of them each record can be checked alone.
        """
        record: RecordBuilder = self._writer._Writer__record_builder  # type: ignore[attr-defined]
        record.start_record(CHECKSUM_OPCODE)  # type: ignore[arg-type]
        record.write4(self._writer._Writer__data_section_crc)  # type: ignore[attr-defined]
        record.finish_record()
        self._guard(self._writer._Writer__flush)  # type: ignore[attr-defined]
        self._guard(self._file.flush)

    def _guard(self, write: Callable[[], object]) -> None:
        if self._failed is not None:
            raise RecorderFailed(f"{self.path}: stopped after {self._failed}") from self._failed
        try:
            write()
        except OSError as error:
            self._failed = error
            raise RecorderFailed(f"{self.path}: {error}; the log is readable up to here") from error
        except Exception as error:  # of ours, or want of memory: a record may be half there
            self._failed = error
            raise


class _Indexes:
    """The package's list of chunk indexes, on the disk: with 64 channels an hour of them is tens of MB."""

    def __init__(self, folder: Path) -> None:
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115 - as long as the log

    def append(self, index: ChunkIndex) -> None:
        record = RecordBuilder()
        index.write(record)
        self._file.write(record.end())

    def __iter__(self) -> Iterator[_Indexes]:
        """All at once: the package asks each to write itself."""
        yield self

    def write(self, summary: RecordBuilder) -> None:
        self._file.seek(0)
        summary.write(self._file.read())

    def close(self) -> None:
        self._file.close()
