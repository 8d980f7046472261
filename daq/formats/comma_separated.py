"""CSV: a line of names, a line of units, a row a sample; before them a comment line with the description.

Decimal point and comma always, floats in the fewest digits that read back as the same float. Read by Excel,
by `pandas.read_csv(file, comment="#", header=[0, 1])` and by MATLAB's `readtable`.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import pyarrow as pa
from pyarrow import csv as arrow

from daq.allowance import MOST_COLUMNS
from daq.errors import LogError
from daq.formats import description
from daq.formats.contents import TIME_NAMES, TIME_UNITS, Contents, FileFormat, Warn, opened, time_axis
from daq.formats.description import Description
from daq.formats.recording import Recording
from daq.formats.samples import Samples, Scratch
from daq.formats.tables import (
    TIME,
    TableColumns,
    as_csv,
    described_table,
    foreign_table,
    from_csv,
    impact_path,
    new_files,
    table_paths,
    tables_of,
)

_MARK = "# rattle "
_IMPACTS_MARK = "# rattle impacts "
_ROWS_OF_EXCEL = 1_048_576
_HEAD_LINES = 3
_LONGEST_LINE = 1 << 26
_LONGEST_CELL = 1000
_COMMENTS = ("#", '"#')
_DELIMITERS = "\t;,"
_WRONG_ROW = re.compile(
    r"(In CSV column #(?P<column>\d+): )?Row #(?P<row>\d+): "
    r"(Expected (?P<expected>\d+) columns, got (?P<got>\d+)|.*?invalid value '(?P<cell>.*)')",
    re.DOTALL,
)
_NAME_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]")


def write(recording: Recording, path: Path, warn: Warn) -> tuple[Path, ...]:
    """Write a file for every time base, and one of the impacts; raises RattleError."""
    tables = tables_of(recording, warn)
    paths = table_paths(path, tables)
    if max(table.end - table.first for table in tables) > _ROWS_OF_EXCEL - _HEAD_LINES:
        warn(f"more rows than Excel shows ({_ROWS_OF_EXCEL})")
    if recording.impacts:
        paths = (*paths, impact_path(path))
    with ExitStack() as stack:
        files = new_files(stack, paths)
        for file, table in zip(files, tables, strict=False):
            head = io.StringIO()
            head.write(f"{_MARK}{description.encode(recording, table.tracks)}\n")
            rows = csv.writer(head, lineterminator="\n")
            rows.writerow([TIME, *(track.name for track in table.tracks)])
            rows.writerow(["s", *(track.channel.unit for track in table.tracks)])
            file.write(head.getvalue().encode())
            kinds = [pa.float64(), *(pa.from_numpy_dtype(track.samples.dtype) for track in table.tracks)]
            schema = pa.schema([(str(number), kind) for number, kind in enumerate(kinds)])
            options = arrow.WriteOptions(include_header=False, quoting_style="none")
            with arrow.CSVWriter(file, schema, write_options=options) as writer:
                for index, columns in table.batches():
                    seconds = pa.array(index / table.base.sample_rate)
                    writer.write_batch(pa.record_batch([seconds, *columns], schema=schema))
        if recording.impacts:
            marked = f"{_IMPACTS_MARK}{description.encode(recording, ())}\n{as_csv(recording.impacts)}"
            files[-1].write(marked.encode())
    return paths


@dataclass(frozen=True, slots=True)
class _Head:
    """What stands before the numbers, and where these begin, in bytes."""

    own: str
    names: list[str]
    units: dict[str, str]
    delimiter: str
    decimal_point: str
    body: int


def read(path: Path, scratch: Scratch) -> Contents:
    """Read a table of channels; raises LogError."""
    with opened(path) as file:
        if file.read(len(_IMPACTS_MARK)) == _IMPACTS_MARK.encode():
            text, _, table = file.read().decode().partition("\n")
            return Contents((), replace(description.decode(text).rest, impacts=from_csv(table)))
        file.seek(0)
        head = _head(file)
        described = description.decode(head.own) if head.own else None
        found = _columns(file, head, described, scratch)
        time = next((name for name in head.names if name.lower() in TIME_NAMES), None)
        times = None if time is None else found.pop(time)
        if described is not None:
            starts = [track.stretches[0].first_sample for track in described.tracks if track.stretches]
            return described_table(described, found, min(starts, default=0))
        unit = head.units.get(str(time), "s")
        if times is not None and unit not in TIME_UNITS:
            raise LogError(f"its time column is in {unit!r}, not one of {', '.join(TIME_UNITS)}")
        axis = None if times is None else time_axis(times, TIME_UNITS[unit])
        return foreign_table(found, head.units, axis)


def _columns(
    file: BinaryIO, head: _Head, described: Description | None, scratch: Scratch
) -> dict[str, Samples]:
    narrow = {track.name for track in described.tracks if not track.wide} if described else set()
    types = {name: pa.float32() if name in narrow else pa.float64() for name in head.names}
    columns = TableColumns(head.names, scratch, may_be_empty=described is not None)
    file.seek(head.body)
    try:
        with arrow.open_csv(
            file,
            arrow.ReadOptions(column_names=head.names, use_threads=False),  # else it does not say which row
            arrow.ParseOptions(delimiter=head.delimiter),
            arrow.ConvertOptions(column_types=types, null_values=[""], decimal_point=head.decimal_point),
        ) as batches:
            for batch in batches:
                for name, cells in zip(head.names, batch.columns, strict=True):
                    columns.add(name, cells)
    except pa.ArrowInvalid as error:
        raise LogError(f"cannot be read ({_wrong_row(str(error), head.names)})") from error
    return columns.samples()


def _wrong_row(said: str, names: Sequence[str]) -> str:
    """What pyarrow says of a row, by the file's own names."""
    at = _WRONG_ROW.search(said)
    if at is None:
        return " ".join(said.split())[:_LONGEST_CELL]
    column = "" if at["column"] is None else f", column {names[int(at['column'])]}"
    found = " ".join(at["cell"].split())[:_LONGEST_CELL] if at["cell"] else ""
    wrong = f"{found!r} is no number" if column else f"expected {at['expected']} columns, got {at['got']}"
    return f"row {at['row']} of its numbers{column}: {wrong}"


def _head(file: BinaryIO) -> _Head:
    own, line = "", ""
    for line, _ in _lines(file):
        if line.startswith(_MARK):
            own = line.removeprefix(_MARK)
        elif not line.startswith(_COMMENTS) and line.strip():
            break
    else:
        raise LogError("it holds no line of names")
    delimiter = next((each for each in _DELIMITERS if each in line), ",")
    names, units = _names_and_units(_cells(line, delimiter))
    below, below_at = next(_lines(file), ("", 0))
    if not all(_is_number(cell) for cell in _cells(below, delimiter)):
        cells = _cells(below, delimiter)
        if len(cells) != len(names):
            raise LogError(f"{len(names)} names and {len(cells)} units")
        units = {name: unit for name, unit in zip(names, cells, strict=True) if unit}
        below, below_at = next(_lines(file), ("", 0))
    if not below.strip():
        raise LogError("it holds no row of numbers")
    point = "," if delimiter != "," and "," in below else "."
    return _Head(own, names, units, delimiter, point, below_at)


def _lines(file: BinaryIO) -> Iterator[tuple[str, int]]:
    """Lines of text and the byte at which each begins."""
    while True:
        at = file.tell()
        line = file.readline(_LONGEST_LINE)
        if not line:
            return
        try:
            yield line.decode("utf-8-sig").rstrip("\r\n"), at
        except UnicodeDecodeError as error:
            raise LogError(f"it is no text in UTF-8 (byte {at + error.start}); save it as such") from error


def _cells(line: str, delimiter: str) -> list[str]:
    if line.count(delimiter) >= MOST_COLUMNS:
        raise LogError(f"its columns are more than the {MOST_COLUMNS} that are read")
    cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    if len(longest := max(cells, key=len, default="")) > _LONGEST_CELL:
        raise LogError(f"a cell of {len(longest)} characters is neither name nor number")
    return cells


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", ".") or "0")
    except ValueError:
        return False
    return True


def _names_and_units(cells: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Names, with the units that some programs put behind them: `force [N]`."""
    if all(_is_number(cell) for cell in cells):
        raise LogError("it has no line of names above the numbers")
    names, units = [], {}
    for cell in cells:
        match = _NAME_WITH_UNIT.fullmatch(cell)
        names.append(match["name"] if match else cell)
        if match:
            units[match["name"]] = match["unit"].strip()
    if "" in names:
        raise LogError(f"column {names.index('') + 1} has no name")
    return names, units


FORMAT = FileFormat("csv", (".csv", ".txt", ".tsv"), read, write)
