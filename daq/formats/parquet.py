"""Parquet: a column a channel, `sample` and `time` beside them; units in the fields' metadata.

Read by pandas, polars, DuckDB, and by MATLAB's `parquetread`.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from daq.allowance import Allowance
from daq.block import LATEST, NS_PER_S
from daq.errors import LogError
from daq.formats import description
from daq.formats.contents import (
    TIME_NAMES,
    TIME_UNITS,
    Contents,
    FileFormat,
    TimeAxis,
    Warn,
    opened,
    time_axis,
)
from daq.formats.recording import Recording
from daq.formats.samples import Scratch
from daq.formats.tables import (
    KINDS,
    SAMPLE,
    TIME,
    TableColumns,
    TrackTable,
    columns_of,
    described_table,
    foreign_table,
    impact_path,
    impacts_of,
    new_files,
    table_paths,
    tables_of,
)
from daq.formats.thrift import Compact

_MARK = b"rattle"
_IMPACTS_MARK = b"rattle impacts"
_ROW_GROUP = 1 << 20
_BATCH, _IMPACTS = 1 << 16, 1 << 8
"""Rows that are in memory at once; of impacts, in which texts may be long, fewer."""
_MAGIC, _TAIL_BYTES = b"PAR1", 8
_TO_COLUMNS = 4, 1, 3
_CHUNK_BYTES, _DATA_PLACE, _DICTIONARY_PLACE = 7, 9, 11
_UNPACKED_BYTES, _PACKED_BYTES = 2, 3
"""Fields in parquet.thrift: on the way from FileMetaData to ColumnMetaData, of that, and of PageHeader."""
_HEADER_BYTES = 4
"""That take as long as a record. Each byte brings that once, however many columns point to it."""
_STAMP = pa.timestamp("ns", tz="UTC")


def write(recording: Recording, path: Path, warn: Warn) -> tuple[Path, ...]:
    """Write a file for every time base, and one of the impacts; raises RattleError."""
    tables = tables_of(recording, warn)
    paths = table_paths(path, tables)
    if recording.impacts:
        paths = (*paths, impact_path(path))
    with ExitStack() as stack:
        files = new_files(stack, paths)
        for file, table in zip(files, tables, strict=False):
            _write_table(file, table, recording)
        if recording.impacts:
            kinds = {int: pa.int64(), float: pa.float64(), str: pa.string()}
            schema = pa.schema(
                [pa.field(name, kinds[kind], nullable=False) for name, kind in KINDS.items()],
                metadata={_IMPACTS_MARK: description.encode(recording, ())},
            )
            pq.write_table(pa.table(columns_of(recording.impacts), schema=schema), files[-1])
    return paths


def _write_table(file: IO[bytes], table: TrackTable, recording: Recording) -> None:
    fields = [pa.field(SAMPLE, pa.int64(), nullable=False), pa.field(TIME, _STAMP, nullable=False)]
    for track in table.tracks:
        kind = pa.from_numpy_dtype(track.samples.dtype)
        fields.append(pa.field(track.name, kind, metadata=track.channel.metadata()))
    schema = pa.schema(fields, metadata={_MARK: description.encode(recording, table.tracks)})
    encodings = dict.fromkeys((SAMPLE, TIME), "DELTA_BINARY_PACKED")
    rows: list[pa.RecordBatch] = []
    with pq.ParquetWriter(
        file, schema, compression="zstd", use_dictionary=False, column_encoding=encodings
    ) as writer:
        for index, columns in table.batches():
            stamps = pa.array(times_ns(table, index), pa.int64()).cast(_STAMP)
            rows.append(pa.record_batch([pa.array(index), stamps, *columns], schema=schema))
            if sum(len(each) for each in rows) >= _ROW_GROUP:
                writer.write_table(pa.Table.from_batches(rows), row_group_size=_ROW_GROUP)
                rows = []
        if rows:
            writer.write_table(pa.Table.from_batches(rows), row_group_size=_ROW_GROUP)


def times_ns(table: TrackTable, index: np.ndarray) -> np.ndarray:
    """Times of samples in ns since the Unix epoch, shape of `index`, true to one."""
    start = int(index[0])
    # counted from the batch's own first sample, a double is fine enough
    offset = (index - start) * (NS_PER_S / table.base.sample_rate)
    return table.base.at(start) + np.rint(offset).astype(np.int64)


def read(path: Path, scratch: Scratch) -> Contents:
    """Read a table of channels; raises LogError."""
    with opened(path) as file:
        allowance = Allowance(path, file.fileno())
        _check_pages(file, allowance)
        return _read(file, scratch, allowance)


def _read(file: BinaryIO, scratch: Scratch, allowance: Allowance) -> Contents:
    with pq.ParquetFile(file) as table:
        schema = table.schema_arrow
        metadata = schema.metadata or {}
        if (described := metadata.get(_IMPACTS_MARK)) is not None:
            rest = description.decode(described.decode()).rest
            rows: dict[str, list[Any]] = {name: [] for name in schema.names}
            for batch in _batches(table, schema.names, allowance, _IMPACTS):
                allowance.spend(records=2 * len(batch))
                for name, cells in batch.to_pydict().items():
                    rows[name] += cells
            return Contents((), replace(rest, impacts=impacts_of(rows)))
        if _MARK not in metadata:
            return _foreign(table, scratch, allowance)
        own = description.decode(metadata[_MARK].decode())
        names = [name for name in schema.names if name != TIME]
        columns = TableColumns(names, scratch, may_be_empty=True)
        _read_columns(table, names, columns, allowance)
        found = columns.samples()
        index = found.pop(SAMPLE)
        if not len(index):
            raise LogError("its table is empty")
        first, last = (int(index.read(at, at + 1)[0]) for at in (0, len(index) - 1))
        if last - first != len(index) - 1:
            raise LogError("rows of its table are missing")
        return described_table(own, found, first)


def _check_pages(file: BinaryIO, allowance: Allowance) -> None:
    """Spend what pages say that they unpack to, which is what is taken: the footer's sizes need not be true.

    Of each column one page is in memory, whole. Of a damaged footer pyarrow may end the process when it is
    asked for a column's places: they are read here.
    """
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        length = int.from_bytes(data[-_TAIL_BYTES : -len(_MAGIC)], "little")
        footer = len(data) - _TAIL_BYTES - length
        if data[-len(_MAGIC) :] != _MAGIC or footer < 0:
            raise LogError("it does not end as a Parquet file does")
        for column in Compact(data, footer).structs(*_TO_COLUMNS):
            places = [column.get(_DATA_PLACE, -1), column.get(_DICTIONARY_PLACE) or LATEST]
            at, largest = min(places), 0
            end = at + column.get(_CHUNK_BYTES, -1)
            if not 0 <= at <= end <= len(data):
                raise LogError("pages of a column are not in the file")
            while at < end:
                page = Compact(data, at)
                sizes = page.integers()
                unpacked = max(sizes.get(_UNPACKED_BYTES, 0), 0)
                allowance.spend(unpacked=unpacked, records=1 + (page.at - at) // _HEADER_BYTES)
                largest = max(largest, unpacked)
                at = page.at + max(sizes.get(_PACKED_BYTES, 0), 0)
            allowance.spend(held=largest, records=1)


def _batches(
    table: pq.ParquetFile, names: list[str], allowance: Allowance, rows: int = _BATCH
) -> Iterator[pa.RecordBatch]:
    rows = min(rows, _ROW_GROUP // max(len(names), 1))
    for batch in table.iter_batches(max(rows, 1), columns=names):
        allowance.spend(unpacked=batch.nbytes)
        yield batch


def _read_columns(
    table: pq.ParquetFile, names: list[str], columns: TableColumns, allowance: Allowance
) -> None:
    for batch in _batches(table, names, allowance):
        for name, cells in zip(batch.schema.names, batch.columns, strict=True):
            columns.add(name, cells)


def _foreign(table: pq.ParquetFile, scratch: Scratch, allowance: Allowance) -> Contents:
    fields = list(table.schema_arrow)
    time = next((field for field in fields if field.name.lower() in TIME_NAMES), None)
    are = pa.types
    numbers = (are.is_floating, are.is_integer, are.is_boolean)
    names = [each.name for each in fields if each is not time and any(kind(each.type) for kind in numbers)]
    columns = TableColumns(names, scratch, may_be_empty=False)
    _read_columns(table, names, columns, allowance)
    axis, start_ns = (None, None) if time is None else _times(table, time, scratch, allowance)
    units = {field.name: _unit(field) for field in fields if _unit(field)}
    left = [field.name for field in fields if field is not time and field.name not in names]
    notes = [f"left out: {name}, which holds no numbers" for name in left]
    return foreign_table(columns.samples(), units, axis, start_ns, notes)


def _unit(field: pa.Field) -> str:
    return str((field.metadata or {}).get(b"unit", b"").decode())


def _times(
    table: pq.ParquetFile, field: pa.Field, scratch: Scratch, allowance: Allowance
) -> tuple[TimeAxis, int | None]:
    """The axis of a column of stamps, with the time of its first, or of a column of seconds."""
    column, start_ns = scratch.column(), None
    for batch in _batches(table, [field.name], allowance):
        cells = batch.column(0)
        if cells.null_count:
            raise LogError("its time column has empty cells")
        if pa.types.is_timestamp(field.type):
            stamps = cells.cast(pa.timestamp("ns", tz=field.type.tz)).cast(pa.int64()).to_numpy()
            start_ns = int(stamps[0]) if start_ns is None else start_ns
            column.add((stamps - start_ns).astype(np.float64) / NS_PER_S)
        else:
            column.add(cells.to_numpy())
    unit = _unit(field) or "s"
    if unit not in TIME_UNITS:
        raise LogError(f"its time column is in {unit}, not one of {', '.join(TIME_UNITS)}")
    seconds = 1.0 if start_ns is not None else TIME_UNITS[unit]
    return time_axis(column.samples(), seconds), start_ns


FORMAT = FileFormat("parquet", (".parquet", ".pq"), read, write, one_rate=True)
