"""Chunks of a log: checked and taken apart; those of a finished log by their index, opened ahead in a thread.

A chunk's checksum is verified, and its size is bounded before memory is taken.
"""

from __future__ import annotations

import os
import struct
import zlib
from array import array
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk

from daq.allowance import MOST_COLUMNS, Allowance

MAXIMUM_CHUNK_BYTES = 64 << 20
"""A quarter of a second of 1 000 channels at 51.2 kHz, measured and predicted, fits in."""
LONGEST_RECORD_BYTES = 2 * MAXIMUM_CHUNK_BYTES
RECORD_HEAD = struct.Struct("<BQ")
"""Opcode, and length of what follows."""
_MESSAGE = struct.Struct("<HIQQ")
_RECORD_READ = 512
"""Bytes unpacked in the time that a record takes, however short."""
_AHEAD = 4
_KEPT_BYTES = 16 << 20
"""What a prediction lags behind its measurement: 2.4 s of 16 channels at 51.2 kHz. Who lags more opens them
anew. With four times as much a replay takes a fifth longer, since it works in memory that is not cached."""
_HEAD = struct.Struct("<BQQQQII")
"""Opcode and length of the record; first and last time, size, checksum, letters of the compression's name."""
_LENGTH = struct.Struct("<Q")
_IDS, _LATEST_NS = 1 << 16, (1 << 64) - 1
"""Of a log's channels, and its times."""


class IndexedChunk(NamedTuple):
    """Where a chunk lies in its file, and what its log's index says of it."""

    start: int
    length: int
    size: int
    first_ns: int
    last_ns: int
    channel_ids: array[int]


@dataclass(frozen=True, slots=True)
class OpenedChunk:
    """A chunk's content, its records whole and one after another; `declared` are those of channels."""

    data: bytes
    declared: tuple[bytes, ...]

    def messages(self) -> Iterator[tuple[int, ...]]:
        """Channel, sequence, log time, publish time, start and end of each; there may be millions."""
        for opcode, start, end in records(self.data):
            if opcode == Opcode.MESSAGE:
                yield *_MESSAGE.unpack_from(self.data, start), start + _MESSAGE.size, end


def open_chunk(chunk: Chunk, allowance: Allowance, sealed: bool) -> OpenedChunk:
    """Decompress and verify a chunk; raises ValueError, struct.error or ZstdError if it is damaged.

    `sealed`: its writer gives each a checksum; elsewhere 0 means that there is none.
    """
    data = _content(chunk, allowance, sealed)
    declared: dict[bytes, None] = {}
    for opcode, start, end in records(data):
        allowance.spend(unpacked=_RECORD_READ)
        if opcode == Opcode.MESSAGE:
            if end - start < _MESSAGE.size:
                raise ValueError(f"a message of {end - start} bytes")
            continue
        if opcode == Opcode.CHANNEL:
            declared[data[start:end]] = None
            if len(declared) > MOST_COLUMNS:
                raise ValueError(f"it declares more than {MOST_COLUMNS} channels")
    return OpenedChunk(data, tuple(declared))


def records(data: bytes | memoryview) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of each record's content; raises ValueError, struct.error where it is none."""
    position, end = 0, len(data)
    while position < end:
        opcode, length = RECORD_HEAD.unpack_from(data, position)
        position += RECORD_HEAD.size
        if opcode == 0 or position + length > end:
            raise ValueError(f"no record {opcode} of {length} bytes fits at byte {position}")
        yield opcode, position, position + length
        position += length


def _content(chunk: Chunk, allowance: Allowance, sealed: bool) -> bytes:
    size = chunk.uncompressed_size
    if size > MAXIMUM_CHUNK_BYTES:
        raise ValueError(f"it claims {size} bytes, more than {MAXIMUM_CHUNK_BYTES}")
    allowance.spend(passed=size + len(chunk.data))
    if chunk.compression == "":
        data = bytes(chunk.data)
    elif chunk.compression != "zstd":
        raise ValueError(f"its compression is {chunk.compression!r}, not zstd")
    elif zstandard.frame_content_size(chunk.data) == size:
        data = zstandard.ZstdDecompressor().decompress(chunk.data)
    else:
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            data = stream.read(size + 1)  # one byte more, so that a longer content shows and takes no memory
    if len(data) != size:
        raise ValueError(f"it holds {len(data)} bytes or more and claims {size}")
    if (sealed or chunk.uncompressed_crc) and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("its checksum is wrong")
    return data


class IndexedChunks:
    """Chunks of a file, each opened once for all passes that are close together.

    Decompressing and verifying takes as long as what is done with the samples, and runs beside it.
    """

    def __init__(self, descriptor: int, indexes: Sequence[IndexedChunk], sealed: bool) -> None:
        self._descriptor, self._sealed = descriptor, sealed
        self._indexes = sorted(indexes)
        self._opened: OrderedDict[int, tuple[int, Future[OpenedChunk]]] = OrderedDict()
        self._executor: ThreadPoolExecutor | None = None

    def __len__(self) -> int:
        return len(self._indexes)

    def close(self) -> None:
        """End the thread that opens chunks ahead."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = None
        self._opened.clear()

    def last_ns(self, after_ns: Mapping[int, int]) -> dict[int, int]:
        """Log time at which the last chunk ends that holds a channel and begins after its time; else 0."""
        begins, lasts = np.full(_IDS, _LATEST_NS, np.uint64), np.zeros(_IDS, np.uint64)
        for channel, time_ns in after_ns.items():
            begins[channel] = min(time_ns + 1, _LATEST_NS)
        for each in self._indexes:
            ids = np.frombuffer(each.channel_ids, np.uint16)
            ids = ids[begins[ids] <= each.first_ns]
            lasts[ids] = np.maximum(lasts[ids], each.last_ns)
        return {channel: int(lasts[channel]) for channel in after_ns}

    def passing(
        self, ids: frozenset[int] | None, start_ns: int | None, end_ns: int | None, allowance: Allowance
    ) -> Iterator[tuple[int, Future[OpenedChunk]]]:
        """Place in the file and content of chunks, in file order.

        Those that may hold messages of channels `ids` (None: of any) in a stretch of log time.
        """
        wanted = []
        for each in self._indexes:
            early = start_ns is not None and each.last_ns < start_ns
            late = end_ns is not None and each.first_ns > end_ns
            # A writer may leave out the index of messages: then any channel may be in it.
            if ids is None or not each.channel_ids or not ids.isdisjoint(each.channel_ids):
                wanted += [] if early or late else [each]
        for number, index in enumerate(wanted):
            ahead = 0
            for following in wanted[number : number + _AHEAD]:
                ahead += following.size
                if following is index or ahead <= _KEPT_BYTES:
                    self._open(following, allowance)
            yield index.start, self._open(index, allowance)

    def _open(self, index: IndexedChunk, allowance: Allowance) -> Future[OpenedChunk]:
        if index.start in self._opened:
            self._opened.move_to_end(index.start)
            return self._opened[index.start][1]
        if self._executor is None:
            self._executor = ThreadPoolExecutor(1, thread_name_prefix="chunks of a log")
        opening = self._executor.submit(_read, self._descriptor, index, allowance, self._sealed)
        self._opened[index.start] = index.size, opening
        while len(self._opened) > 1 and sum(size for size, _ in self._opened.values()) > _KEPT_BYTES:
            self._opened.popitem(last=False)
        return opening


def _read(descriptor: int, index: IndexedChunk, allowance: Allowance, sealed: bool) -> OpenedChunk:
    if index.length > LONGEST_RECORD_BYTES:
        raise ValueError(f"its index says it is {index.length} bytes long")
    record = memoryview(os.pread(descriptor, index.length, index.start))
    if len(record) < max(index.length, _HEAD.size) or record[0] != Opcode.CHUNK:
        raise ValueError(f"there is no chunk at byte {index.start}")
    # As mcap.records.Chunk.read, but without copies of the data.
    _, _, start_ns, end_ns, size, crc, letters = _HEAD.unpack_from(record)
    if size != index.size:
        raise ValueError(f"it claims {size} bytes and its index {index.size}")
    at = _HEAD.size + letters
    (length,) = _LENGTH.unpack_from(record, at)
    data: Any = record[at + _LENGTH.size :][:length]
    compression = bytes(record[_HEAD.size : at]).decode()
    return open_chunk(Chunk(compression, data, end_ns, start_ns, crc, size), allowance, sealed)
