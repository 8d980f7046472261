"""The records inside a chunk, its checksum verified and its size bounded before memory is taken."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from io import BytesIO
from typing import NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk

MAXIMUM_CHUNK_BYTES = 64 << 20
"""A quarter of a second of 1 000 channels at 51.2 kHz, measured and predicted, fits in."""
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


class Place(NamedTuple):
    """A message in an opened chunk: its channel, and where its data lies."""

    channel_id: int
    sequence: int
    log_ns: int
    publish_ns: int
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class OpenedChunk:
    """A chunk's content with its channels and messages, in their order."""

    data: bytes
    channels: tuple[Channel, ...]
    places: tuple[Place, ...]


def open_chunk(chunk: Chunk) -> OpenedChunk:
    """Decompress and verify a chunk; raises ValueError, struct.error or ZstdError if it is damaged."""
    data = _content(chunk)
    channels: list[Channel] = []
    places: list[Place] = []
    position, end = 0, len(data)
    while position < end:
        opcode, length = _RECORD.unpack_from(data, position)
        position += _RECORD.size
        if opcode == 0 or position + length > end:
            raise ValueError(f"no record {opcode} of {length} bytes fits at byte {position}")
        if opcode == Opcode.MESSAGE:
            if length < _MESSAGE.size:
                raise ValueError(f"a message of {length} bytes")
            channel, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(data, position)
            start = position + _MESSAGE.size
            places.append(Place(channel, sequence, log_ns, publish_ns, start, position + length))
        elif opcode == Opcode.CHANNEL:
            channels.append(Channel.read(ReadDataStream(BytesIO(data[position : position + length]))))
        position += length
    return OpenedChunk(data, tuple(channels), tuple(places))


def _content(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > MAXIMUM_CHUNK_BYTES:
        raise ValueError(f"it claims {size} bytes, more than {MAXIMUM_CHUNK_BYTES}")
    data = _decompressed(chunk, size)
    if len(data) != size:
        raise ValueError(f"it holds {len(data)} bytes or more and claims {size}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("its checksum is wrong")
    return data


def _decompressed(chunk: Chunk, size: int) -> bytes:
    """At most one byte more than `size`, so that a longer content shows and takes no memory."""
    if chunk.compression == "":
        return bytes(chunk.data)
    if chunk.compression == "zstd":
        if zstandard.frame_content_size(chunk.data) == size:
            return zstandard.ZstdDecompressor().decompress(chunk.data)
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            return stream.read(size + 1)
    raise ValueError(f"its compression is {chunk.compression!r}, not zstd")
