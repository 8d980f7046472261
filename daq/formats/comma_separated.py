"""CSV: a line of names with units, a row a sample; the description in the last column, beside the first rows.

Decimal point and comma always, floats in the fewest digits that read back as the same float. Read by Excel,
by `pandas.read_csv(file)` and by MATLAB's `readtable` as it is: for them a comment line would be that of the
names, and a file beside it would get lost.
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

from daq.allowance import MOST_COLUMNS, Allowance
from daq.block import NS_PER_S
from daq.errors import LogError
from daq.formats import description
from daq.formats.contents import TIME_NAMES, TIME_UNITS, Contents, FileFormat, Warn, opened, time_axis
from daq.formats.description import Described, Description
from daq.formats.recording import Recording, Track
from daq.formats.samples import Samples, Scratch
from daq.formats.tables import (
    KINDS,
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
_DESCRIPTION = "rattle"
_BEGINS_DESCRIPTION = '{"rattle":'
_BEGINS_IMPACTS = ",".join(list(KINDS)[:3])
_ROWS_OF_EXCEL, _CELL_OF_EXCEL = 1_048_576, 32_000
_BLOCK = 1 << 20
"""Bytes that are read at once; a row has to fit."""
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
    if max(table.end - table.first for table in tables) >= _ROWS_OF_EXCEL:
        warn(f"more rows than Excel shows ({_ROWS_OF_EXCEL})")
    if recording.impacts:
        paths = (*paths, impact_path(path))
    with ExitStack() as stack:
        files = new_files(stack, paths)
        for file, table in zip(files, tables, strict=False):
            late_s = (table.base.zero_ns - recording.zero_ns) / NS_PER_S
            head = io.StringIO()
            names = [f"{TIME} [s]", *map(_heading, table.tracks), _DESCRIPTION]
            csv.writer(head, lineterminator="\n").writerow(names)
            file.write(head.getvalue().encode())
            kinds = [pa.float64(), *(pa.from_numpy_dtype(track.samples.dtype) for track in table.tracks)]
            schema = pa.schema([(str(number), kind) for number, kind in enumerate([*kinds, pa.string()])])
            options = arrow.WriteOptions(include_header=False, quoting_style="needed")
            told = _pieces(description.encode(recording, table.tracks), table.end - table.first)
            with arrow.CSVWriter(file, schema, write_options=options) as writer:
                for index, columns in table.batches():
                    seconds = pa.array(index / table.base.sample_rate + late_s)
                    beside = pa.array([next(told, None) for _ in index], pa.string())
                    writer.write_batch(pa.record_batch([seconds, *columns, beside], schema=schema))
        if recording.impacts:
            files[-1].write(as_csv(recording.impacts).encode())
    return paths


def _heading(track: Track | Described) -> str:
    unit = track.channel.unit
    return f"{track.name} [{unit}]" if unit else track.name


def _pieces(text: str, rows: int) -> Iterator[str]:
    """A text in cells that Excel shows whole, where there are rows enough."""
    size = max(_CELL_OF_EXCEL, -(-len(text) // rows))
    return (text[at : at + size] for at in range(0, len(text), size))


@dataclass(frozen=True, slots=True)
class _Head:
    """What stands before the numbers, and where these begin, in bytes."""

    own: str
    names: list[str]
    units: dict[str, str]
    delimiter: str
    decimal_point: str
    body: int
    beside: tuple[str, ...] = ()
    """Columns that hold no samples."""

    @property
    def columns(self) -> list[str]:
        return [*self.names, *self.beside]


def read(path: Path, scratch: Scratch) -> Contents:
    """Read a table of channels; raises LogError."""
    with opened(path) as file:
        first = file.readline(_LONGEST_LINE).decode("utf-8-sig", "replace")
        if first.startswith((_IMPACTS_MARK, _BEGINS_IMPACTS)):
            rest = Recording(())
            if first.startswith(_IMPACTS_MARK):  # as they were written once
                rest = description.decode(first.removeprefix(_IMPACTS_MARK)).rest
            else:
                file.seek(0)
            lines = (_checked(line, ",") for line, _ in _lines(file))
            return Contents((), replace(rest, impacts=from_csv(lines, Allowance(path, file.fileno()))))
        file.seek(0)
        head = _head(file)
        described = description.decode(head.own) if head.own else None
        if described is not None:
            names = {_heading(track).strip(): track.name for track in described.tracks}
            head = replace(head, names=[names.get(name, name) for name in head.names])
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
            arrow.ReadOptions(
                column_names=head.columns,
                use_threads=False,  # else it does not say which row
                block_size=_BLOCK + 2 * len(head.own),
            ),
            arrow.ParseOptions(delimiter=head.delimiter),
            arrow.ConvertOptions(
                column_types=types,
                null_values=[""],
                decimal_point=head.decimal_point,
                include_columns=head.names,
            ),
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
    cells, body = _cells(line, delimiter), file.tell()
    if cells[-1] == _DESCRIPTION:
        described = "".join(_last_cells(file, len(cells), delimiter))
        file.seek(body)
        if described.startswith(_BEGINS_DESCRIPTION):
            numbers = delimiter.join(next(_lines(file))[0].split(delimiter)[: len(cells) - 1])
            point = _point(numbers, delimiter)
            return _Head(described, cells[:-1], {}, delimiter, point, body, (_DESCRIPTION,))
    names, units = _names_and_units(cells)
    below, below_at = next(_lines(file), ("", 0))
    if not all(_is_number(cell) for cell in _cells(below, delimiter)):
        cells = _cells(below, delimiter)
        if len(cells) != len(names):
            raise LogError(f"{len(names)} names and {len(cells)} units")
        units = {name: unit for name, unit in zip(names, cells, strict=True) if unit}
        below, below_at = next(_lines(file), ("", 0))
    if not below.strip():
        raise LogError("it holds no row of numbers")
    return _Head(own, names, units, delimiter, _point(below, delimiter), below_at)


def _point(row: str, delimiter: str) -> str:
    return "," if delimiter != "," and "," in row else "."


def _last_cells(file: BinaryIO, columns: int, delimiter: str) -> Iterator[str]:
    """Those of the rows that follow, up to the first that is empty; before it a row has numbers only."""
    length = 0
    for line, _ in _lines(file):
        cells = line.split(delimiter, columns - 1)
        if len(cells) < columns or not cells[-1]:
            return
        cell = cells[-1]
        length += len(cell)
        if length > _LONGEST_LINE:
            raise LogError("its description has no end")
        yield cell[1:-1].replace('""', '"') if cell.startswith('"') else cell


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


def _checked(line: str, delimiter: str) -> str:
    if line.count(delimiter) >= MOST_COLUMNS:
        raise LogError(f"its columns are more than the {MOST_COLUMNS} that are read")
    return line


def _cells(line: str, delimiter: str) -> list[str]:
    cells = [cell.strip() for cell in next(csv.reader([_checked(line, delimiter)], delimiter=delimiter), [])]
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


FORMAT = FileFormat("csv", (".csv", ".txt", ".tsv"), read, write, one_rate=True)
