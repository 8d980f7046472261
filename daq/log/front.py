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
_LENGTH = 8
_FOOTER_BEFORE_CHECKSUM = struct.Struct("<BQQQ")
_FOOTER_BYTES = _FOOTER_BEFORE_CHECKSUM.size + 4


def metadata_and_chunks(descriptor: int, note: Callable[[str], None]) -> Iterator[Metadata | Chunk]:
    """What a log holds in file order; `note` is told what is wrong with its frame.

    Behind damage it goes on at the next chunk that is whole. Chunks are checked by who opens them.
    """
    for opcode, record in _records(descriptor, note):
        try:
            if opcode == Opcode.METADATA:
                yield Metadata.read(_content(record))
            elif opcode == Opcode.CHUNK:
                yield Chunk.read(_content(record))
        except (ValueError, struct.error, McapError) as error:
            note(f"a record of kind {opcode} is damaged ({type(error).__name__})")


def check_data(descriptor: int, note: Callable[[str], None]) -> None:
    """Tell `note` where the frame of a log, or the checksum of all before its summary, is wrong."""
    checksum, ended = zlib.crc32(MCAP0_MAGIC), False
    for opcode, record in _records(descriptor, note):
        if opcode == Opcode.DATA_END:
            ended = True
            if DataEnd.read(_content(record)).data_section_crc not in (0, checksum):
                note("the checksum of its data is wrong")
        checksum = zlib.crc32(record, checksum)
    if not ended:
        note("nothing says where its data ends")


def _records(descriptor: int, note: Callable[[str], None]) -> Iterator[tuple[int, bytes]]:
    size = os.fstat(descriptor).st_size
    position = len(MCAP0_MAGIC)
    if os.pread(descriptor, position, 0) != MCAP0_MAGIC:
        note("it does not begin as an MCAP file does")
        position = 0
    opcode = 0
    while opcode != Opcode.FOOTER:
        try:
            opcode, record = _record_at(descriptor, position, size)
            position += len(record)
        except ValueError as error:
            note(str(error))
            found = _next_whole_chunk(descriptor, position) if position < size else None
            if found is None:
                return
            opcode, (record, position) = Opcode.CHUNK, found
        yield opcode, record


def _content(record: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(record[_RECORD.size :]))


def check_summary(descriptor: int) -> None:
    """Raise ValueError if a file has no end, or a summary that is not what its writer wrote."""
    size = os.fstat(descriptor).st_size
    position = size - len(MCAP0_MAGIC) - _FOOTER_BYTES
    opcode, record = _record_at(descriptor, max(position, 0), size)
    if opcode != Opcode.FOOTER:
        raise ValueError(CUT)
    _check_end(descriptor, position, size, Footer.read(_content(record)))


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


def _next_whole_chunk(descriptor: int, position: int) -> tuple[bytes, int] | None:
    """Record and end of the first chunk at or behind `position` whose checksum is right."""
    with mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ) as file:
        found = file.find(_COMPRESSION, position)
        while found >= 0:
            begin = found - _BEFORE_COMPRESSION.size
            if begin >= position and (record := _chunk_at(file, begin)):
                return record, begin + len(record)
            found = file.find(_COMPRESSION, found + 1)
    return None


def _chunk_at(file: mmap.mmap, begin: int) -> bytes:
    """Its record by the lengths inside of it, since its own may be what is damaged; empty if it is none."""
    at = begin + _BEFORE_COMPRESSION.size + len(_COMPRESSION)
    length = int.from_bytes(file[at : at + _LENGTH], "little")
    content = file[begin + _RECORD.size : at + _LENGTH + min(length, MAXIMUM_CHUNK_BYTES)]
    record = _RECORD.pack(Opcode.CHUNK, len(content)) + content
    try:
        chunk = Chunk.read(_content(record))
        open_chunk(chunk)
    except (ValueError, struct.error, McapError, zstandard.ZstdError):
        return b""
    return record if chunk.uncompressed_crc else b""
