"""Checks a log sample by sample, and rebuilds one that a crash left without its end."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, get_args

from mcap.writer import CompressionType, Writer

from daq.block import NS_PER_S
from daq.errors import LogError
from daq.log.codec import decode_block, embedded_schema
from daq.log.reader import LogReader, Origin
from daq.log.writer import MAXIMUM_CHUNK_AGE_S

_SAMPLE_TOPICS = tuple(f"/{origin}/" for origin in get_args(Origin))
_SCHEMA_OF_TOPIC = {"/event": "Event", "/gap": "Gap", "/clock": "Clock", "/impact": "Impact"}


@dataclass(frozen=True, slots=True)
class TopicReport:
    """Accounting of one topic: blocks, samples, samples missing in between, breaks of `sequence`."""

    topic: str
    messages: int
    samples: int
    missing: int
    sequence_breaks: int
    """Blocks out of sequence, or with samples that came before."""


@dataclass(frozen=True, slots=True)
class LogReport:
    """What `verify_log` found; `sound` means complete, no checksum wrong, no gap outside the ledger."""

    path: Path
    complete: bool
    damage: str
    topics: tuple[TopicReport, ...]
    ledger_missing: int

    @property
    def sound(self) -> bool:
        """True if nothing is damaged and every missing sample is in the gap ledger."""
        missing = sum(topic.missing for topic in self.topics)
        breaks = sum(topic.sequence_breaks for topic in self.topics)
        return self.complete and not self.damage and missing == self.ledger_missing and not breaks


def verify_log(path: Path) -> LogReport:
    """Read every message of a log with its checksums and account for every sample index."""
    damage = ""
    state: dict[str, _Account] = {}
    with LogReader(path) as log:
        try:
            for message in log.messages():
                account = state.setdefault(message.topic, _Account())
                account.add(message.topic, message.sequence, message.data)
            ledger = sum(gap.count for gap in log.gaps())
            log.check_frame()
        except LogError as error:
            damage, ledger = str(error), 0
        reports = tuple(account.report(topic) for topic, account in state.items())
        return LogReport(path, log.complete, damage or log.damage, reports, ledger)


class _Account:
    """Running account of one topic."""

    def __init__(self) -> None:
        self.messages = self.samples = self.missing = self.breaks = 0
        self.next_sample = 0

    def add(self, topic: str, sequence: int, data: bytes) -> None:
        if sequence != self.messages:
            self.breaks += 1
        self.messages += 1
        if not topic.startswith(_SAMPLE_TOPICS):
            return
        block = decode_block(topic, data)
        self.breaks += block.first_sample < self.next_sample
        self.missing += max(block.first_sample - self.next_sample, 0)
        self.samples += len(block)
        self.next_sample = block.end_sample

    def report(self, topic: str) -> TopicReport:
        return TopicReport(topic, self.messages, self.samples, self.missing, self.breaks)


def recover_log(damaged: Path, recovered: Path) -> LogReport:
    """Copy every whole chunk of `damaged` to the new file `recovered`, then verify what was written.

    Topics that are none of the format's are left out.

    Samples of a damaged chunk are missing in it, outside the gap ledger, so that its report is not sound.
    """
    with LogReader(damaged) as log, _create(recovered) as file:
        writer = Writer(file, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile="", library=log.library or "rattle recover")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for topic, metadata in log.topic_metadata().items():
            if not topic.startswith(_SAMPLE_TOPICS) and topic not in _SCHEMA_OF_TOPIC:
                continue  # another program's topic, whose schema this reader does not keep
            name = _SCHEMA_OF_TOPIC.get(topic, "SampleBlock")
            if name not in schemas:
                schemas[name] = writer.register_schema(f"rattle.{name}", "protobuf", embedded_schema(name))
            channels[topic] = writer.register_channel(topic, "protobuf", schemas[name], metadata)
        for name, record in log.metadata.items():
            writer.add_metadata(name, record)
        with suppress(LogError):  # the file's frame is broken there: what comes before it is kept
            _copy_messages(log, writer, channels)
        writer.finish()
    return verify_log(recovered)


def _copy_messages(log: LogReader, writer: Writer, channels: dict[str, int]) -> None:
    chunk_opened_ns: int | None = None
    for message in log.messages(channels, skip_damaged=True):
        opened_ns = message.log_ns if chunk_opened_ns is None else chunk_opened_ns
        if message.log_ns - opened_ns >= MAXIMUM_CHUNK_AGE_S * NS_PER_S:
            writer.flush()
            opened_ns = message.log_ns
        chunk_opened_ns = opened_ns
        writer.add_message(
            channels[message.topic], message.log_ns, message.data, message.publish_ns, message.sequence
        )


def _create(path: Path) -> BinaryIO:
    try:
        return path.open("xb")
    except OSError as error:
        raise LogError(f"cannot create {path}: {error.strerror}") from error
