"""Small logs of which every number is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, Header
from mcap.writer import MCAP0_MAGIC

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.channel import Channel
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
