"""A log read from its front, where it has no index or none that can be trusted: also behind damage."""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer, Metadata
from mcap.writer import MCAP0_MAGIC

from daq.log.chunks import MAXIMUM_CHUNK_BYTES, open_chunk

CUT = "it ends in the middle, as a crash leaves it"
_RECORD = struct.Struct("<BQ")
_LONGEST = 2 * MAXIMUM_CHUNK_BYTES
_COMPRESSION = struct.pack("<I", 4) + b"zstd"
_BEFORE_COMPRESSION = struct.Struct("<BQQQQI")
"""Of a chunk's record: opcode, length, first and last time, size and checksum of its content."""
_LENGTH = struct.Struct("<Q")
_FOOTER_BEFORE_CHECKSUM = struct.Struct("<BQQQ")
_FOOTER_BYTES = _FOOTER_BEFORE_CHECKSUM.size + 4


def metadata_and_chunks(descriptor: int, note: Callable[[str], None]) -> Iterator[Metadata | Chunk]:
    """What a log holds in file order; `note` is told what is wrong with its frame and checksums.

    Behind damage it goes on at the next chunk that is whole. Chunks are checked by who opens them.
    """
    size = os.fstat(descriptor).st_size
    position, checksum = len(MCAP0_MAGIC), zlib.crc32(MCAP0_MAGIC)
    if os.pread(descriptor, position, 0) != MCAP0_MAGIC:
        note("it does not begin as an MCAP file does")
        position = 0
    intact, data_ended = True, False
    while True:
        try:
            opcode, record = _record_at(descriptor, position, size)
            content = ReadDataStream(BytesIO(record[_RECORD.size :]))
            if opcode == Opcode.FOOTER:
                if not data_ended:
                    note("nothing says where its data ends")
                _check_end(descriptor, position, size, Footer.read(content))
                return
            if opcode == Opcode.DATA_END:
                data_ended, claimed = True, DataEnd.read(content).data_section_crc
                if intact and claimed not in (0, checksum):
                    note("the checksum of its data is wrong")
            elif opcode == Opcode.METADATA:
                yield Metadata.read(content)
            elif opcode == Opcode.CHUNK:
                yield Chunk.read(content)
            position, checksum = position + len(record), zlib.crc32(record, checksum)
        except (ValueError, KeyError, struct.error, EOFError, McapError) as error:
            intact = False
            found = _next_whole_chunk(descriptor, position) if position < size else None
            note(str(error) or type(error).__name__)
            if found is None:
                return
            chunk, position = found
            yield chunk


def check_summary(descriptor: int) -> None:
    """Raise ValueError if a file has no end, or a summary that is not what its writer wrote."""
    size = os.fstat(descriptor).st_size
    position = size - len(MCAP0_MAGIC) - _FOOTER_BYTES
    opcode, record = _record_at(descriptor, max(position, 0), size)
    if opcode != Opcode.FOOTER:
        raise ValueError(CUT)
    _check_end(descriptor, position, size, Footer.read(ReadDataStream(BytesIO(record[_RECORD.size :]))))


def _record_at(descriptor: int, position: int, size: int) -> tuple[int, bytes]:
    head = os.pread(descriptor, _RECORD.size, position)
    if len(head) < _RECORD.size:
        raise ValueError(CUT)
    opcode, length = _RECORD.unpack(head)
    if opcode not in Opcode.__members__.values():
        raise ValueError(f"there is no record of kind {opcode} (byte {position})")
    if position + _RECORD.size + length > size:
        raise ValueError(CUT)
    if length > _LONGEST:
        raise ValueError(f"a record of {length} bytes (byte {position})")
    return opcode, os.pread(descriptor, _RECORD.size + length, position)


def _check_end(descriptor: int, position: int, size: int, footer: Footer) -> None:
    begin = footer.summary_start or position
    if not position - _LONGEST <= begin <= position:
        raise ValueError(f"its summary begins at byte {begin}")
    checked = _FOOTER_BEFORE_CHECKSUM.size + position - begin
    if footer.summary_crc not in (0, zlib.crc32(os.pread(descriptor, checked, begin))):
        raise ValueError("the checksum of its summary is wrong")
    if os.pread(descriptor, len(MCAP0_MAGIC) + 1, size - len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise ValueError("it does not end as an MCAP file does")


def _next_whole_chunk(descriptor: int, position: int) -> tuple[Chunk, int] | None:
    """The first chunk at or behind `position` whose checksum is right, and where it ends."""
    with mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ) as file:
        found = file.find(_COMPRESSION, position)
        while found >= 0:
            begin = found - _BEFORE_COMPRESSION.size
            if begin >= position and (chunk := _chunk_at(file, begin)) is not None:
                return chunk, found + len(_COMPRESSION) + _LENGTH.size + len(chunk.data)
            found = file.find(_COMPRESSION, found + 1)
    return None


def _chunk_at(file: mmap.mmap, begin: int) -> Chunk | None:
    """By the lengths inside of it: that of the record may be what is damaged."""
    _, _, start_ns, end_ns, size, checksum = _BEFORE_COMPRESSION.unpack_from(file, begin)
    at = begin + _BEFORE_COMPRESSION.size + len(_COMPRESSION)
    if at + _LENGTH.size > len(file):
        return None
    (length,) = _LENGTH.unpack_from(file, at)
    data = file[at + _LENGTH.size : at + _LENGTH.size + min(length, MAXIMUM_CHUNK_BYTES)]
    chunk = Chunk("zstd", data, end_ns, start_ns, checksum, size)
    try:
        open_chunk(chunk)
    except (ValueError, struct.error, zstandard.ZstdError):
        return None
    return chunk if checksum and len(data) == length else None
