"""Channels side by side: a table for every time base, a row for every sample index.

A table cannot hold two rates, so a run of several becomes several: `run.csv` has the most rows, and beside
it lie `run.1000Hz.csv` and so on.
"""

from __future__ import annotations

import csv
import io
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import IO, Any, get_args, get_type_hints

import numpy as np
import pyarrow as pa

from daq.allowance import MOST_COLUMNS, Allowance
from daq.errors import LogError, RattleError
from daq.formats.contents import Column, Contents, TimeAxis, Warn, described_contents, new_file
from daq.formats.description import Description
from daq.formats.recording import Recording, TimeBase, Track
from daq.formats.samples import Samples, Scratch, ScratchColumn, Window
from daq.log.reader import Origin
from daq.log.records import Impact

TABLE = "impacts"
"""How formats call it: a group, a variable, the end of a file's name."""
KINDS: Mapping[str, type] = {field.name: get_type_hints(Impact)[field.name] for field in fields(Impact)}
"""int, float or str of each column, in their order."""
_ROWS = 1 << 16
_CELLS_A_SAMPLE = 1 << 10
"""Of a table at most: so channels of a second each may lie a quarter of an hour apart."""
_FEW = 64
"""Samples, however few there are."""
SAMPLE, TIME = "sample", "time"


def columns_of(impacts: Sequence[Impact]) -> dict[str, list[Any]]:
    """The columns, each with a value an impact."""
    rows = [astuple(impact) for impact in impacts]
    return {name: [row[number] for row in rows] for number, name in enumerate(KINDS)}


def impacts_of(columns: Mapping[str, Iterable[Any]]) -> list[Impact]:
    """The impacts of such columns; raises LogError where they are no such table."""
    _check_names(columns)
    try:
        return [_impact(row) for row in zip(*(columns[name] for name in KINDS), strict=True)]
    except ValueError as error:
        raise LogError(f"its table of impacts is damaged ({error})") from error


def _check_names(names: Iterable[str]) -> None:
    if missing := [name for name in KINDS if name not in names]:
        raise LogError(f"its table of impacts has no column {', '.join(missing)}")


def _impact(cells: Iterable[Any]) -> Impact:
    """Of a row, its cells in the order of `KINDS`."""
    try:
        return Impact(*(kind(cell) for kind, cell in zip(KINDS.values(), cells, strict=True)))
    except (ValueError, TypeError, OverflowError) as error:
        raise LogError(f"its table of impacts is damaged ({error})") from error


def as_csv(impacts: Sequence[Impact]) -> str:
    """A line of names and a row an impact; floats in the fewest digits that read back as the same float."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(KINDS)
    rows.writerows(astuple(impact) for impact in impacts)
    return text.getvalue()


def from_csv(lines: Iterable[str], allowance: Allowance) -> list[Impact]:
    """Read what `as_csv` wrote, in lines that are not too long; raises LogError where it cannot be read."""
    rows = csv.reader(lines)
    names = next(rows, [])
    _check_names(names)
    places, impacts = [names.index(name) for name in KINDS], []
    for row in rows:
        if len(row) != len(names):
            raise LogError("a row of its table of impacts is cut short")
        allowance.spend(records=2)
        impacts.append(_impact(row[place] for place in places))
    return impacts


def impact_path(path: Path) -> Path:
    """The file of the impacts beside that of the samples."""
    return path.with_name(f"{path.stem}.{TABLE}{path.suffix}")


@dataclass(frozen=True, slots=True)
class TrackTable:
    """Tracks on one time base, with rows for sample `first` to `end`."""

    base: TimeBase
    tracks: tuple[Track, ...]
    first: int
    end: int

    def batches(self) -> Iterator[tuple[np.ndarray, list[pa.Array]]]:
        """Sample indices and columns, some thousand rows at once; null where a sample is missing."""
        left = [deque(track.stretches) for track in self.tracks]
        for start in range(self.first, self.end, _ROWS):
            stop = min(start + _ROWS, self.end)
            columns = []
            for track, stretches in zip(self.tracks, left, strict=True):
                low, high = max(start, track.first_sample), min(stop, track.end_sample)
                values = np.full(stop - start, np.nan, track.samples.dtype)
                missing = np.ones(stop - start, np.bool_)
                if low < high:
                    read = track.samples.read(low - track.first_sample, high - track.first_sample)
                    values[low - start : high - start] = read
                while stretches and stretches[0].first_sample < stop:
                    stretch = stretches[0]
                    missing[max(stretch.first_sample - start, 0) : stretch.end_sample - start] = False
                    if stretch.end_sample > stop:
                        break
                    stretches.popleft()
                columns.append(pa.array(values, mask=missing if missing.any() else None, from_pandas=False))
            yield np.arange(start, stop), columns


def tables_of(recording: Recording, warn: Warn) -> list[TrackTable]:
    """Tables of a recording, one for each time base.

    Raises RattleError if there is not one sample, LogError where there is next to none for a table's size.
    """
    tables = _by_time_base(recording, warn)
    for table in tables:
        _check_filled(table)
    return tables


def _by_time_base(recording: Recording, warn: Warn) -> list[TrackTable]:
    groups: list[list[Track]] = []
    for track in recording.tracks:
        if not track.stretches:
            continue
        if strays := track.strays():
            warn(f"{strays}, which make the column of times")
        base = track.stretches[0].base
        group = next((each for each in groups if each[0].stretches[0].base.agrees(base)), None)
        if group is None:
            groups.append([track])
        else:
            group.append(track)
    if not groups:
        raise RattleError("there is no sample in it to export")
    groups[0].extend(track for track in recording.tracks if not track.stretches)
    tables = []
    for group in groups:
        filled = [track for track in group if track.stretches]
        first, end = min(each.first_sample for each in filled), max(each.end_sample for each in filled)
        tables.append(TrackTable(filled[0].stretches[0].base, tuple(group), first, end))
    return sorted(tables, key=lambda table: (table.first - table.end, -table.base.sample_rate))


def _check_filled(table: TrackTable) -> None:
    """Raise LogError where a table would hold next to nothing: two samples may lie years apart."""
    samples = sum(stretch.count for track in table.tracks for stretch in track.stretches)
    rows = table.end - table.first
    if rows * len(table.tracks) > _CELLS_A_SAMPLE * (samples + _FEW):
        few = f"{samples} samples in {rows} rows"
        raise LogError(f"its samples lie too far apart for a table ({few}): export fewer channels at once")


def other_rates(recording: Recording) -> list[Track]:
    """Tracks with samples that do not fit into the first table of a recording."""
    first = _by_time_base(recording, lambda _: None)[0].tracks
    return [track for track in recording.tracks if track.stretches and track not in first]


def table_paths(path: Path, tables: Sequence[TrackTable]) -> tuple[Path, ...]:
    """The file of each table: the first gets `path`, the others are named after their rates."""
    names: list[str] = []
    for table in tables[1:]:
        plain = f"{np.format_float_positional(table.base.sample_rate, 4, fractional=False, trim='-')}Hz"
        same = sum(name.split("-")[0] == plain for name in names)
        names.append(f"{plain}-{same + 1}" if same else plain)
    return (path, *(path.with_name(f"{path.stem}.{name}{path.suffix}") for name in names))


def new_files(stack: ExitStack, paths: Sequence[Path]) -> list[IO[bytes]]:
    """Create all files, or none."""
    return [stack.enter_context(new_file(path)) for path in paths]


class TableColumns:
    """Collects the columns of a table from its batches, in scratch.

    Only rattle's own tables say what an empty cell means, so any other may have none: `may_be_empty`.
    """

    def __init__(self, names: Sequence[str], scratch: Scratch, may_be_empty: bool) -> None:
        if len(names) > MOST_COLUMNS:
            raise LogError(f"{len(names)} columns are more than the {MOST_COLUMNS} that are read")
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            raise LogError(f"these columns come twice: {', '.join(twice[:9])}")
        self._columns: dict[str, ScratchColumn] = {name: scratch.column() for name in names}
        self._may_be_empty = may_be_empty

    def add(self, name: str, cells: pa.Array) -> None:
        """Append cells of a column; empty ones become NaN. Raises LogError where they may not be."""
        column = self._columns[name]
        if cells.null_count and not self._may_be_empty:
            row = next(at for at, cell in enumerate(cells) if not cell.is_valid)
            raise LogError(f"column {name} has an empty cell in row {len(column) + row + 1} of its numbers")
        column.add(cells.to_numpy(zero_copy_only=False))

    def samples(self) -> dict[str, Samples]:
        return {name: column.samples() for name, column in self._columns.items()}


def described_table(description: Description, found: dict[str, Samples], first: int) -> Contents:
    """Columns of a table that rattle wrote, whose first row is sample `first`."""
    windows: dict[str, Samples] = {}
    for track in description.tracks:
        if track.stretches and track.name in found:
            start = track.stretches[0].first_sample - first
            stop = track.stretches[-1].end_sample - first
            if start < 0 or stop > len(found[track.name]):
                raise LogError(f"{track.name}: {stop} rows are described, {len(found[track.name])} are there")
            windows[track.name] = Window(found[track.name], start, stop)
    return described_contents(description, windows)


def foreign_table(
    columns: Mapping[str, Samples],
    units: Mapping[str, str],
    axis: TimeAxis | None,
    start_ns: int | None = None,
    notes: Sequence[str] = (),
) -> Contents:
    """Columns of a table that another program wrote, or that has lost its description on the way."""
    found = []
    for name, samples in columns.items():
        origin = next((each for each in get_args(Origin) if name.startswith(f"{each}/")), None)
        short = name.removeprefix(f"{origin}/")
        rate, start_s = (axis.rate, axis.start_s) if axis else (None, 0.0)
        found.append(Column(short, samples, origin or "measured", units.get(name), rate, start_ns, start_s))
    return Contents(tuple(found), notes=notes)
