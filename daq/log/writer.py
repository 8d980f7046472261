"""Writes a run's log; after the first failed write it accepts nothing more."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from daq.block import NS_PER_S, Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.errors import RecorderFailed
from daq.log import codec
from daq.log.codec import embedded_schema
from daq.log.records import ClockRecord, Event, Gap, Impact

MAXIMUM_CHUNK_AGE_S = 0.25  # the format's: no crash costs more than what the last chunk holds
_CHUNK_BYTES = 1 << 20


class LogWriter:
    """One MCAP file: channels are declared, then blocks, events, gaps and clocks added in any order.

    Sample indices are accounted for per topic: a block that starts later than the last one ended leaves a
    `Gap` in the log, one that starts earlier is refused. Not thread-safe: one thread owns a writer.
    """

    def __init__(self, path: Path, library: str = "rattle") -> None:
        self.path = path
        self._library = library
        self._next_sample: dict[str, int] = {}
        self._sequence: dict[str, int] = {}
        self._topics: dict[str, int] = {}
        self._told_gaps: set[tuple[str, int, int]] = set()
        self._schemas: dict[str, int] = {}
        self._chunk_opened_ns = 0
        self._failed: OSError | None = None
        self._open = False

    def open(self) -> LogWriter:
        """Create the file; refuses to overwrite one."""
        try:
            self._file = self.path.open("xb")
        except FileExistsError as error:
            raise RecorderFailed(f"{self.path} exists already; name another file") from error
        except OSError as error:
            raise RecorderFailed(f"cannot create {self.path}: {error}") from error
        self._writer = Writer(
            self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._writer.start(profile="", library=self._library)
        self._open = True
        return self

    def __enter__(self) -> LogWriter:
        return self.open()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def declare(self, origin: str, channel: Channel) -> None:
        """Register /`origin`/`channel.name`, so that it is in the file even if no sample ever comes."""
        self._register(f"/{origin}/{channel.name}", "SampleBlock", channel.metadata())

    def add_metadata(self, name: str, record: Mapping[str, str]) -> None:
        """Add a metadata record (`scenario`, `run`)."""
        self._guard(lambda: self._writer.add_metadata(name, dict(record)))

    def add_block(self, origin: str, block: SampleBlock, host_ns: int) -> None:
        """Add samples of a declared channel; `host_ns` is when the host had them (Unix epoch)."""
        self.add_encoded_block(origin, block, codec.encode_block(block), host_ns)

    def add_encoded_block(
        self, origin: str, block: SampleBlock, data: bytes, host_ns: int, record_gap: bool = True
    ) -> None:
        """Add a block as it stands in another log; `record_gap` is False where its ledger is copied too."""
        topic = f"/{origin}/{block.channel}"
        expected = self._next_sample.get(topic, 0)
        if block.first_sample < expected:
            raise RecorderFailed(f"{topic}: sample {block.first_sample} comes twice (next is {expected})")
        gap = (block.channel, expected, block.first_sample - expected)
        if gap in self._told_gaps:
            self._told_gaps.remove(gap)
        elif block.first_sample > expected and record_gap:
            missing = block.first_sample - expected
            start_ns = sample_time_ns(block.time_ns, -missing, block.sample_rate)
            cause = "start of stream" if expected == 0 else "samples missing"
            if not block.flags & Flag.SAMPLES_MISSING_BEFORE and expected:
                cause = "not flagged by the source"
            self._record("/gap", "Gap", Gap(start_ns, block.channel, expected, missing, cause), host_ns)
        self._add(topic, data, host_ns, block.time_ns)
        self._next_sample[topic] = block.end_sample

    def add_event(self, event: Event) -> None:
        self._record("/event", "Event", event, event.time_ns)

    def add_gap(self, gap: Gap, host_ns: int) -> None:
        """Add an entry of the gap ledger; one that is added before the block after it gets no second."""
        self._told_gaps.add((gap.channel, gap.first_sample, gap.count))
        self._record("/gap", "Gap", gap, host_ns)

    def add_clock(self, clock: ClockRecord) -> None:
        self._record("/clock", "Clock", clock, clock.time_ns)

    def add_impact(self, impact: Impact, host_ns: int) -> None:
        """Add an impact that was found in the samples."""
        self._record("/impact", "Impact", impact, host_ns)

    def flush_if_older(self, host_ns: int) -> None:
        """End the chunk if it is older than 0.25 s; to be called now and then when no block comes."""
        if not self._chunk_opened_ns:
            return
        age_ns = host_ns - self._chunk_opened_ns
        if not 0 <= age_ns < MAXIMUM_CHUNK_AGE_S * NS_PER_S:  # negative: the host's clock was set back
            self._guard(self._writer.flush)
            self._chunk_opened_ns = 0

    def close(self) -> None:
        """Finish and sync the file. After a failed write it stays as it is: readable up to the last chunk."""
        if not self._open:
            return
        self._open = False
        try:
            if self._failed is None:
                self._writer.finish()
                self._file.flush()
                os.fsync(self._file.fileno())
        except OSError as error:
            raise RecorderFailed(f"{self.path}: {error}") from error
        finally:
            with suppress(OSError):  # what a failed write left in its buffer fails once more, and is told
                self._file.close()

    def _register(self, topic: str, schema: str, metadata: dict[str, str]) -> None:
        if topic in self._topics:
            return
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(
                f"rattle.{schema}", "protobuf", embedded_schema(schema)
            )
        self._topics[topic] = self._writer.register_channel(
            topic, "protobuf", self._schemas[schema], metadata
        )

    def _record(
        self, topic: str, schema: str, record: Event | Gap | ClockRecord | Impact, host_ns: int
    ) -> None:
        self._register(topic, schema, {})
        self._add(topic, codec.encode_record(record), host_ns, record.time_ns)

    def _add(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        self.flush_if_older(log_ns)
        sequence = self._sequence.get(topic, 0)
        self._sequence[topic] = sequence + 1
        if not self._chunk_opened_ns:
            self._chunk_opened_ns = log_ns
        self._guard(
            lambda: self._writer.add_message(
                self._topics[topic], log_time=log_ns, data=data, publish_time=publish_ns, sequence=sequence
            )
        )

    def _guard(self, write: Callable[[], object]) -> None:
        if self._failed is not None:
            raise RecorderFailed(f"{self.path}: stopped after {self._failed}") from self._failed
        try:
            write()
        except OSError as error:
            self._failed = error
            raise RecorderFailed(f"{self.path}: {error}; the log is readable up to here") from error
