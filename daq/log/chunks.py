"""The chunks of a finished log by their index: opened ahead in a thread, kept while several passes run."""

from __future__ import annotations

import os
import struct
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex

from daq.log.chunk import OpenedChunk, open_chunk

_AHEAD = 4
_KEPT_BYTES = 16 << 20
"""What a prediction lags behind its measurement: 2.4 s of 16 channels at 51.2 kHz. Who lags more opens them
anew. With four times as much a replay takes a fifth longer, since it works in memory that is not cached."""
_HEAD = struct.Struct("<BQQQQII")
"""Opcode and length of the record; first and last time, size, checksum, letters of the compression's name."""
_LENGTH = struct.Struct("<Q")


class IndexedChunks:
    """Chunks of a file, each opened once for all passes that are close together.

    Decompressing and verifying takes as long as what is done with the samples, and runs beside it.
    """

    def __init__(self, descriptor: int, indexes: Sequence[ChunkIndex]) -> None:
        self._descriptor = descriptor
        self._indexes = sorted(indexes, key=lambda each: each.chunk_start_offset)
        self._opened: OrderedDict[int, tuple[int, Future[OpenedChunk]]] = OrderedDict()
        self._executor: ThreadPoolExecutor | None = None

    def close(self) -> None:
        """End the thread."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = None
        self._opened.clear()

    def passing(
        self, channel_ids: frozenset[int] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[tuple[int, Future[OpenedChunk]]]:
        """Place in the file and content of chunks, in file order.

        Those that may hold messages of these channels (None: of any) in a stretch of log time.
        """
        wanted = [each for each in self._indexes if _may_hold(each, channel_ids, start_ns, end_ns)]
        for number, index in enumerate(wanted):
            for following in wanted[number : number + _AHEAD]:
                self._open(following)
            yield index.chunk_start_offset, self._open(index)

    def _open(self, index: ChunkIndex) -> Future[OpenedChunk]:
        offset = index.chunk_start_offset
        if offset in self._opened:
            self._opened.move_to_end(offset)
            return self._opened[offset][1]
        if self._executor is None:
            self._executor = ThreadPoolExecutor(1, thread_name_prefix="chunks of a log")
        opening = self._executor.submit(_read, self._descriptor, index)
        self._opened[offset] = index.uncompressed_size, opening
        while len(self._opened) > _AHEAD and sum(size for size, _ in self._opened.values()) > _KEPT_BYTES:
            self._opened.popitem(last=False)
        return opening


def _read(descriptor: int, index: ChunkIndex) -> OpenedChunk:
    record = memoryview(os.pread(descriptor, index.chunk_length, index.chunk_start_offset))
    if len(record) < max(index.chunk_length, _HEAD.size) or record[0] != Opcode.CHUNK:
        raise ValueError(f"there is no chunk at byte {index.chunk_start_offset}")
    # As mcap.records.Chunk.read, but without copies of the data.
    _, _, start_ns, end_ns, size, crc, letters = _HEAD.unpack_from(record)
    at = _HEAD.size + letters
    (length,) = _LENGTH.unpack_from(record, at)
    data: Any = record[at + _LENGTH.size :][:length]
    compression = bytes(record[_HEAD.size : at]).decode()
    return open_chunk(Chunk(compression, data, end_ns, start_ns, crc, size))


def _may_hold(
    index: ChunkIndex, channel_ids: frozenset[int] | None, start_ns: int | None, end_ns: int | None
) -> bool:
    if start_ns is not None and index.message_end_time < start_ns:
        return False
    if end_ns is not None and index.message_start_time > end_ns:
        return False
    # A writer may leave out the index of messages: then any channel may be in it.
    indexed = index.message_index_offsets
    return channel_ids is None or not indexed or not channel_ids.isdisjoint(indexed)
