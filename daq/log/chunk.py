"""The records inside a chunk, its checksum verified and its size bounded before memory is taken."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message

MAXIMUM_CHUNK_BYTES = 64 << 20
"""A quarter of a second of 1 000 channels at 51.2 kHz, measured and predicted, fits in."""
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


def chunk_records(chunk: Chunk) -> Iterator[Channel | Message]:
    """Channels and messages of a chunk in their order; raises ValueError or ZstdError if it is damaged."""
    data = _content(chunk)
    position = 0
    while position < len(data):
        opcode, length = _RECORD.unpack_from(data, position)
        position += _RECORD.size
        if opcode == 0 or position + length > len(data):
            raise ValueError(f"no record {opcode} of {length} bytes fits at byte {position}")
        if opcode == Opcode.MESSAGE:
            yield _message(data, position, length)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(data[position : position + length])))
        position += length


def _message(data: bytes, position: int, length: int) -> Message:
    if length < _MESSAGE.size:
        raise ValueError(f"a message of {length} bytes")
    channel, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(data, position)
    body = data[position + _MESSAGE.size : position + length]
    return Message(channel, log_ns, body, publish_ns, sequence)


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
        return chunk.data
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            return stream.read(size + 1)
    raise ValueError(f"its compression is {chunk.compression!r}, not zstd")
