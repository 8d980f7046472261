"""Small logs of which every number is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk, Header
from mcap.writer import MCAP0_MAGIC, IndexType, Writer

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.codec import embedded_schema, encode_block
from daq.log.writer import LogWriter

RATE = 1000.0
START_NS = 1_790_000_000 * NS_PER_S
BLOCK = 100


def block(number: int, channel: str = "a", dtype: str = "f4") -> SampleBlock:
    """Block `number` of a ramp: sample n is n."""
    first = number * BLOCK
    values = np.arange(first, first + BLOCK).astype(dtype)
    return SampleBlock(channel, first, sample_time_ns(START_NS, first, RATE), RATE, values)


def host_ns(each: SampleBlock) -> int:
    return sample_time_ns(each.time_ns, len(each), RATE)


def write_ramp(
    path: Path, blocks: int = 30, channels: tuple[str, ...] = ("a", "b"), scenario: str = 'name = "ramp"'
) -> Path:
    """A log of `blocks` x 0.1 s of every channel."""
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": scenario})
        for name in channels:
            log.declare("measured", Channel(name, "N"))
        for number in range(blocks):
            for name in channels:
                each = block(number, name)
                log.add_block("measured", each, host_ns(each))
    return path


def crashed_file(path: Path, *chunks: Chunk) -> Path:
    """A file that holds these chunks and no end."""
    builder = RecordBuilder()
    Header("", "test").write(builder)
    for chunk in chunks:
        chunk.write(builder)
    path.write_bytes(MCAP0_MAGIC + builder.end())
    return path


def copied_by_others(run: Path, target: Path) -> Path:
    """The same log as another program may write it, without checksums."""
    with run.open("rb") as source, target.open("wb") as file:
        reader, writer = make_reader(source), Writer(file, enable_crcs=False)
        writer.start(library="another")
        numbers: dict[int, int] = {}
        for _, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in numbers:
                numbers[channel.id] = writer.register_channel(channel.topic, "protobuf", 0, channel.metadata)
            number, times = numbers[channel.id], (message.log_time, message.publish_time)
            writer.add_message(number, times[0], message.data, times[1], message.sequence)
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        writer.finish()
    return target


def write_foreign(
    path: Path,
    crc_of_chunks: bool = False,
    crc_of_data: bool = False,
    chunked: bool = True,
    index: IndexType = IndexType.ALL,
    topics: tuple[str, ...] = ("/measured/a",),
) -> Path:
    """Two blocks in two chunks as another program may write them, with checksums or none.

    The summary has one where chunks have.
    """
    with path.open("wb") as file:
        writer = Writer(
            file,
            enable_crcs=crc_of_chunks,
            enable_data_crcs=crc_of_data,
            use_chunking=chunked,
            index_types=index,
        )
        writer.start(library="another")
        schema = writer.register_schema("rattle.SampleBlock", "protobuf", embedded_schema("SampleBlock"))
        channels = [writer.register_channel(topic, "protobuf", schema, {"unit": "N"}) for topic in topics]
        for number in range(2):
            data = encode_block(block(number))
            for channel in channels:
                writer.add_message(channel, START_NS, data, START_NS, sequence=number)
            writer.flush()
        writer.finish()
    return path
