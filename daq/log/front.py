"""A log read from its front, where it has no index or none that can be trusted: also behind damage."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, Metadata
from mcap.writer import MCAP0_MAGIC

from daq.log.chunks import MAXIMUM_CHUNK_BYTES, open_chunk
from daq.log.records import CHECKSUM_OPCODE

CUT = "it ends in the middle, as a crash leaves it"
_RECORD = struct.Struct("<BQ")
_LONGEST = 2 * MAXIMUM_CHUNK_BYTES
_COMPRESSION = struct.pack("<I", 4) + b"zstd"
_BEFORE_COMPRESSION = struct.Struct("<BQQQQI")
"""Of a chunk's record: opcode, length, first and last time, size and checksum of its content."""
_LENGTH = 8
_CHECKSUM_BYTES = 4
_ZSTD = b"\x28\xb5\x2f\xfd"
_WINDOW = 1 << 20
_NO_RECORD = (ValueError, OverflowError, struct.error, McapError)
"""What the MCAP package raises on the content of a damaged record."""
_FOOTER_BEFORE_CHECKSUM = struct.Struct("<BQQQ")
_FOOTER_BYTES = _FOOTER_BEFORE_CHECKSUM.size + 4


def metadata_and_chunks(descriptor: int, note: Callable[[str], None]) -> Iterator[Metadata | Chunk]:
    """What a log holds in file order; `note` is told what is wrong with its frame.

    Behind damage it goes on at the next chunk that is whole. Chunks are checked by who opens them.
    """
    checksum = zlib.crc32(MCAP0_MAGIC)
    for opcode, record in _records(descriptor, note):
        if opcode == CHECKSUM_OPCODE and int.from_bytes(record[_RECORD.size :], "little") != checksum:
            note("the checksum of what stands before it is wrong")
        checksum = zlib.crc32(record, checksum)
        try:
            if opcode == Opcode.METADATA:
                yield Metadata.read(_content(record))
            elif opcode == Opcode.CHUNK:
                yield Chunk.read(_content(record))
        except _NO_RECORD as error:
            note(f"a record of kind {opcode} is damaged ({type(error).__name__})")


def check_data(descriptor: int, note: Callable[[str], None]) -> None:
    """Tell `note` where the frame of a log, or the checksum of all before its summary, is wrong."""
    checksum, ended = zlib.crc32(MCAP0_MAGIC), False
    for opcode, record in _records(descriptor, note):
        if opcode == Opcode.DATA_END:
            ended = True
            # its content is the checksum: 0 where its writer made none
            if int.from_bytes(record[_RECORD.size :], "little") not in (0, checksum):
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
        except OSError as error:
            note(f"it cannot be read at byte {position}: {error.strerror}")
            return
        except ValueError as error:
            opcode, (record, found) = Opcode.CHUNK, _next_whole_chunk(descriptor, position, size)
            note(f"a record is damaged (byte {position})" if record else str(error))
            if not record:
                return
            position = found
        position += len(record)
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
    if opcode not in (*Opcode.__members__.values(), CHECKSUM_OPCODE):
        raise ValueError(f"there is no record of kind {opcode} (byte {position})")
    if length > _LONGEST or (opcode == CHECKSUM_OPCODE and length != _CHECKSUM_BYTES):
        raise ValueError(f"a record of {length} bytes (byte {position})")
    if position + _RECORD.size + length > size:
        end = os.pread(descriptor, _RECORD.size, size - _RECORD.size - _CHECKSUM_BYTES)
        whole = end == _RECORD.pack(
            CHECKSUM_OPCODE, _CHECKSUM_BYTES
        )  # then no record was cut: a length is wrong
        raise ValueError(f"a record of {length} bytes (byte {position})" if whole else CUT)
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


def _next_whole_chunk(descriptor: int, position: int, size: int) -> tuple[bytes, int]:
    """The first chunk at or behind `position` whose checksum is right, and where; empty if there is none."""
    for start in range(position, size, _WINDOW):
        window = os.pread(descriptor, _WINDOW + len(_COMPRESSION) - 1, start)
        found = window.find(_COMPRESSION)
        while found >= 0:
            begin = start + found - _BEFORE_COMPRESSION.size
            if begin >= position and (record := _chunk_at(descriptor, begin, size)):
                return record, begin
            found = window.find(_COMPRESSION, found + 1)
    return b"", size


def _chunk_at(descriptor: int, begin: int, size: int) -> bytes:
    """Its record by the lengths inside of it, since its own may be what is damaged; empty if it is none."""
    fixed = _BEFORE_COMPRESSION.size + len(_COMPRESSION)
    head = os.pread(descriptor, fixed + _LENGTH + len(_ZSTD), begin)
    length = int.from_bytes(head[fixed : fixed + _LENGTH], "little")
    if not head.endswith(_ZSTD) or length > min(MAXIMUM_CHUNK_BYTES, size - begin - fixed - _LENGTH):
        return b""
    content = os.pread(descriptor, fixed + _LENGTH + length - _RECORD.size, begin + _RECORD.size)
    record = _RECORD.pack(Opcode.CHUNK, len(content)) + content
    try:
        chunk = Chunk.read(_content(record))
        open_chunk(chunk)
    except (*_NO_RECORD, zstandard.ZstdError):
        return b""
    return record if chunk.uncompressed_crc else b""
