"""A log read from its front, where it has no index or none that can be trusted: also behind damage."""

from __future__ import annotations

import os
import struct
import zlib
from array import array
from collections.abc import Callable, Iterator
from io import BytesIO
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, Header, Metadata, MetadataIndex, Statistics
from mcap.writer import MCAP0_MAGIC

from daq.allowance import MOST_DESCRIPTION_BYTES, Allowance
from daq.errors import LogError
from daq.log.chunks import LONGEST_RECORD_BYTES, MAXIMUM_CHUNK_BYTES, RECORD_HEAD, IndexedChunk, open_chunk
from daq.log.records import CHECKSUM_OPCODE

CUT = "it ends in the middle, as a crash leaves it"
ANOTHER = "another log begins"
_OUTSIDE = "messages outside of chunks are not read"
_COMPRESSION = struct.pack("<I", 4) + b"zstd"
_BEFORE_COMPRESSION = struct.Struct("<BQQQQI")
"""Of a chunk's record: opcode, length, first and last time, size and checksum of its content."""
_CHUNK_CHECKSUM = slice(_BEFORE_COMPRESSION.size - 4, _BEFORE_COMPRESSION.size)
_LENGTH = 8
_CHECKSUM_BYTES = 4
_CHECKSUM_HEAD = RECORD_HEAD.pack(CHECKSUM_OPCODE, _CHECKSUM_BYTES)
_LENGTHS = {CHECKSUM_OPCODE: _CHECKSUM_BYTES, Opcode.FOOTER: 20}
_LOG_HEAD = MCAP0_MAGIC + bytes([Opcode.HEADER])
_ZSTD = b"\x28\xb5\x2f\xfd"
_WINDOW = 1 << 20
_NO_RECORD = (ValueError, OverflowError, struct.error, McapError)
"""What the MCAP package raises on the content of a damaged record."""
_FOOTER_BEFORE_CHECKSUM = struct.Struct("<BQQQ")
_FOOTER_BYTES = _FOOTER_BEFORE_CHECKSUM.size + 4
_INDEX = struct.Struct("<QQQQI")
"""Of a chunk's index: first and last time, place, length, bytes of the channels' places that follow."""
_PLACES = np.dtype([("channel", "<u2"), ("at", "<u8")])
_INDEX_REST = struct.Struct("<QI")
_SIZES = struct.Struct("<QQ")


Note = Callable[[str, int], None]
"""Is told what is wrong, and from which byte on."""


class Summary(NamedTuple):
    """What a finished log says of itself; `declared` are the records of its channels."""

    declared: list[bytes]
    chunks: list[IndexedChunk]
    metadata: dict[str, dict[str, str]]


def metadata_and_chunks(descriptor: int, allowance: Allowance, note: Note) -> Iterator[Metadata | Chunk]:
    """What a log holds in file order; `note` is told what is wrong with its frame.

    Behind damage it goes on at the next chunk that is whole. Chunks are checked by who opens them.
    """
    checksum, described = zlib.crc32(MCAP0_MAGIC), 0
    for position, opcode, record in _records(descriptor, allowance, note):
        if opcode == CHECKSUM_OPCODE and int.from_bytes(record[RECORD_HEAD.size :], "little") != checksum:
            note("the checksum of what stands before it is wrong", position)
        checksum = zlib.crc32(record, checksum)
        try:
            if opcode == Opcode.METADATA:
                described += len(record)
                if described > MOST_DESCRIPTION_BYTES:
                    raise ValueError("metadata without end")
                _check_metadata(descriptor, record, position)
                yield Metadata.read(_content(record))
            elif opcode == Opcode.CHUNK:
                yield Chunk.read(_content(record))
            elif opcode == Opcode.MESSAGE:
                note(_OUTSIDE, position)
        except _NO_RECORD as error:
            note(f"a record of kind {opcode} is damaged ({type(error).__name__})", position)


def check_data(descriptor: int, allowance: Allowance, note: Note, indexed: int | None) -> int:
    """Tell `note` where the frame of a log, or the checksum of all before its summary, is wrong.

    And where it has other chunks than the `indexed`, and messages outside of them. Returns how many chunks
    neither that checksum nor one of their own covers; with the summary, where that has none.
    """
    checksum, ended, unchecked, chunks = zlib.crc32(MCAP0_MAGIC), False, 0, 0
    position = 0
    for position, opcode, record in _records(descriptor, allowance, note):
        if opcode == Opcode.DATA_END:
            ended = True
            # its content is the checksum: 0 where its writer made none
            told = int.from_bytes(record[RECORD_HEAD.size :], "little")
            if told not in (0, checksum):
                note("the checksum of its data is wrong", position)
            unchecked = 0 if told else unchecked
        elif opcode == Opcode.CHUNK:
            chunks += 1
            unchecked += not any(record[_CHUNK_CHECKSUM])
        elif opcode == Opcode.MESSAGE:
            note(_OUTSIDE, position)
        elif opcode == Opcode.FOOTER:
            unchecked += not any(record[-_CHECKSUM_BYTES:])
        checksum = zlib.crc32(record, checksum)
    if not ended:
        note("nothing says where its data ends", position)
    if indexed not in (None, chunks):
        note(f"its index has {indexed} chunks, and its data {chunks}", position)
    return unchecked


def _records(descriptor: int, allowance: Allowance, note: Note) -> Iterator[tuple[int, int, bytes]]:
    """Where each begins, its kind and its bytes."""
    size = os.fstat(descriptor).st_size
    position = len(MCAP0_MAGIC)
    if os.pread(descriptor, position, 0) != MCAP0_MAGIC:
        note("it does not begin as an MCAP file does", 0)
        position = 0
    opcode = before = 0
    while opcode != Opcode.FOOTER:
        try:
            opcode, record = _record_at(descriptor, position, size)
        except OSError as error:
            note(f"it cannot be read at byte {position}: {error.strerror}", position)
            return
        except ValueError as error:
            # it may be the length of the record before that is wrong, and led past whole ones
            record, found = _next_whole_chunk(descriptor, before + 1, size, allowance)
            if (another := _another_log(descriptor, before + 1, found)) is not None:
                note(f"{ANOTHER} at byte {another}: nothing from there on is read", another)
                return
            whole = position == size and opcode == CHECKSUM_OPCODE
            end = os.pread(descriptor, RECORD_HEAD.size, max(size - RECORD_HEAD.size - _CHECKSUM_BYTES, 0))
            # where a checksum ends the file nothing was cut off: what leads elsewhere is wrong
            damaged = record or (end == _CHECKSUM_HEAD and not whole)
            note(f"a record is damaged (byte {position})" if damaged else str(error), position)
            opcode = Opcode.CHUNK
            if not record:
                return
            position = found
        before, position = position, position + len(record)
        yield before, opcode, record


def _another_log(descriptor: int, begin: int, end: int) -> int | None:
    """Where another log begins in between, as where files were put together; None where none does."""
    for start in range(begin, end, _WINDOW):
        window = os.pread(descriptor, min(_WINDOW + len(_LOG_HEAD) - 1, end - start), start)
        if (found := window.find(_LOG_HEAD)) >= 0:
            return start + found
    return None


def _content(record: bytes) -> ReadDataStream:
    stream = BytesIO(record)  # of the same memory
    stream.seek(RECORD_HEAD.size)
    return ReadDataStream(stream)


def library_of(descriptor: int) -> str:
    """Who wrote a log, by its head; raises ValueError, struct.error or McapError where it has none."""
    opcode, header = _record_at(descriptor, len(MCAP0_MAGIC), os.fstat(descriptor).st_size)
    if opcode != Opcode.HEADER:
        raise ValueError("it does not begin as an MCAP file does")
    _check_between(descriptor, MCAP0_MAGIC, header, len(MCAP0_MAGIC))
    return str(Header.read(_content(header)).library)


def read_summary(descriptor: int) -> Summary:
    """Raises ValueError, struct.error or McapError where there is no end, or no summary as it was written."""
    size = os.fstat(descriptor).st_size
    position = size - len(MCAP0_MAGIC) - _FOOTER_BYTES
    opcode, footer = _record_at(descriptor, max(position, 0), size)
    if opcode != Opcode.FOOTER:
        raise ValueError(CUT)
    if os.pread(descriptor, len(MCAP0_MAGIC), 0) != MCAP0_MAGIC:
        raise ValueError("it does not begin as an MCAP file does")
    summary, places, statistics = Summary([], [], {}), list[int](), None
    for opcode, record in _summary_records(descriptor, position, size, footer):
        if opcode == Opcode.CHANNEL:
            summary.declared.append(record[RECORD_HEAD.size :])
        elif opcode == Opcode.CHUNK_INDEX:
            summary.chunks.append(_indexed(memoryview(record)[RECORD_HEAD.size :]))
        elif opcode == Opcode.STATISTICS:
            statistics = Statistics.read(_content(record))
        elif opcode == Opcode.METADATA_INDEX:
            places.append(MetadataIndex.read(_content(record)).offset)
    _check_summary(summary, statistics)
    summary.metadata.update(_metadata_at(descriptor, places, size))
    return summary


def _check_summary(summary: Summary, statistics: Statistics | None) -> None:
    """Raise ValueError where it cannot be of all of a log."""
    if any(one.start + one.length > two.start for one, two in pairwise(sorted(summary.chunks))):
        raise ValueError("its index has chunks over one another")
    if statistics and statistics.chunk_count != len(summary.chunks):
        raise ValueError("its index does not have all of its chunks")
    if not summary.declared and not (statistics and statistics.channel_count == 0):
        raise ValueError("its summary has no channels")


def _metadata_at(descriptor: int, places: list[int], size: int) -> Iterator[tuple[str, dict[str, str]]]:
    described = 0
    for place in places:
        opcode, record = _record_at(descriptor, place, size)
        described += len(record)
        if opcode != Opcode.METADATA or described > MOST_DESCRIPTION_BYTES:
            raise ValueError(f"no metadata at byte {place}, or without end")
        _check_metadata(descriptor, record, place)
        metadata = Metadata.read(_content(record))
        yield metadata.name, metadata.metadata


def _check_metadata(descriptor: int, record: bytes, place: int) -> None:
    """Raise ValueError where it is not as it was written; of others, or cut behind it, none can tell."""
    size = RECORD_HEAD.size + _CHECKSUM_BYTES
    before = os.pread(descriptor, size, max(place - size, 0))
    cut = not os.pread(descriptor, 1, place + len(record) + size - 1)
    if before.startswith(_CHECKSUM_HEAD) and not cut:  # as behind every record of ours
        told = int.from_bytes(before[RECORD_HEAD.size :], "little")
        _check_between(descriptor, before, record, place, told)


def _check_between(descriptor: int, before: bytes, record: bytes, place: int, checksum: int = 0) -> None:
    """Raise ValueError where the checksum behind the record at `place` is not of `record`.

    `checksum` is that of all up to `before`, which stands in front of it. A log of others has none.
    """
    after = os.pread(descriptor, RECORD_HEAD.size + _CHECKSUM_BYTES, place + len(record))
    told = int.from_bytes(after[RECORD_HEAD.size :], "little")
    ours = checksum or after.startswith(_CHECKSUM_HEAD)
    if ours and told != zlib.crc32(record, zlib.crc32(before, checksum)):
        raise ValueError(f"the checksum of what stands at byte {place} is wrong")


def _indexed(content: memoryview) -> IndexedChunk:
    """As mcap.records.ChunkIndex.read, but two bytes for each channel."""
    first_ns, last_ns, start, length, channels = _INDEX.unpack_from(content)
    ids = np.frombuffer(content[_INDEX.size : _INDEX.size + channels], _PLACES)["channel"]
    _, letters = _INDEX_REST.unpack_from(content, _INDEX.size + channels)
    _, size = _SIZES.unpack_from(content, _INDEX.size + channels + _INDEX_REST.size + letters)
    return IndexedChunk(start, length, size, first_ns, last_ns, array("H", ids.astype("=u2").tobytes()))


def _record_at(descriptor: int, position: int, size: int) -> tuple[int, bytes]:
    head = os.pread(descriptor, RECORD_HEAD.size, position)
    if len(head) < RECORD_HEAD.size:
        raise ValueError(CUT)
    opcode, length = RECORD_HEAD.unpack(head)
    if opcode not in (*Opcode.__members__.values(), CHECKSUM_OPCODE):
        raise ValueError(f"there is no record of kind {opcode} (byte {position})")
    if length > LONGEST_RECORD_BYTES or length != _LENGTHS.get(opcode, length):
        raise ValueError(f"a record of {length} bytes (byte {position})")
    if position + RECORD_HEAD.size + length > size:
        raise ValueError(CUT)
    if opcode == Opcode.FOOTER and position + _FOOTER_BYTES + len(MCAP0_MAGIC) != size:
        raise ValueError(f"an end in its middle (byte {position})")
    return opcode, os.pread(descriptor, RECORD_HEAD.size + length, position)


def _summary_records(descriptor: int, position: int, size: int, footer: bytes) -> Iterator[tuple[int, bytes]]:
    """One by one, since days make gigabytes; raises ValueError behind the last if their checksum is wrong."""
    told, checksum = Footer.read(_content(footer)), 0
    at = told.summary_start or position
    while at < position:
        opcode, record = _record_at(descriptor, at, size)
        checksum = zlib.crc32(record, checksum)
        at += len(record)
        yield opcode, record
    if at != position:
        raise ValueError(f"its summary begins at byte {told.summary_start}")
    if told.summary_crc not in (0, zlib.crc32(footer[: _FOOTER_BEFORE_CHECKSUM.size], checksum)):
        raise ValueError("the checksum of its summary is wrong")
    if os.pread(descriptor, len(MCAP0_MAGIC) + 1, size - len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise ValueError("it does not end as an MCAP file does")


def _next_whole_chunk(descriptor: int, position: int, size: int, allowance: Allowance) -> tuple[bytes, int]:
    """The first chunk at or behind `position` whose checksum is right, and where; empty if there is none."""
    for start in range(position, size, _WINDOW):
        window = os.pread(descriptor, _WINDOW + len(_COMPRESSION) - 1, start)
        found = window.find(_COMPRESSION)
        while found >= 0:
            begin = start + found - _BEFORE_COMPRESSION.size
            if begin >= position and (record := _chunk_at(descriptor, begin, size, allowance)):
                return record, begin
            found = window.find(_COMPRESSION, found + 1)
    return b"", size


def _chunk_at(descriptor: int, begin: int, size: int, allowance: Allowance) -> bytes:
    """Its record by the lengths inside of it, since its own may be what is damaged; empty if it is none."""
    fixed = _BEFORE_COMPRESSION.size + len(_COMPRESSION)
    head = os.pread(descriptor, fixed + _LENGTH + len(_ZSTD), begin)
    length = int.from_bytes(head[fixed : fixed + _LENGTH], "little")
    if not head.endswith(_ZSTD) or length > min(MAXIMUM_CHUNK_BYTES, size - begin - fixed - _LENGTH):
        return b""
    try:
        allowance.spend(unpacked=length)
        content = os.pread(descriptor, fixed + _LENGTH + length - RECORD_HEAD.size, begin + RECORD_HEAD.size)
        record = RECORD_HEAD.pack(Opcode.CHUNK, len(content)) + content
        chunk = Chunk.read(_content(record))
        open_chunk(chunk, allowance, sealed=True)
    except LogError:  # more than may come of the file
        raise
    except (*_NO_RECORD, zstandard.ZstdError):
        return b""
    return record
