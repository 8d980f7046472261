"""Impacts as the columns of a table, one row each; columns have the names and units of `Impact`."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any, get_type_hints

from daq.errors import LogError
from daq.log.records import Impact

TABLE = "impacts"
"""How formats call it: a group, a variable, the end of a file's name."""
KINDS: Mapping[str, type] = {field.name: get_type_hints(Impact)[field.name] for field in fields(Impact)}
"""int, float or str of each column, in their order."""


def columns_of(impacts: Sequence[Impact]) -> dict[str, list[Any]]:
    """The columns, each with a value an impact."""
    rows = [astuple(impact) for impact in impacts]
    return {name: [row[number] for row in rows] for number, name in enumerate(KINDS)}


def impacts_of(columns: Mapping[str, Iterable[Any]]) -> list[Impact]:
    """The impacts of such columns; raises LogError where they are no such table."""
    missing = [name for name in KINDS if name not in columns]
    if missing:
        raise LogError(f"its table of impacts has no column {', '.join(missing)}")
    try:
        typed = [[kind(value) for value in columns[name]] for name, kind in KINDS.items()]
        return [Impact(*row) for row in zip(*typed, strict=True)]
    except (ValueError, TypeError, OverflowError) as error:
        raise LogError(f"its table of impacts is damaged ({error})") from error


def as_csv(impacts: Sequence[Impact]) -> str:
    """A line of names and a row an impact; floats in the fewest digits that read back as the same float."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(KINDS)
    rows.writerows(astuple(impact) for impact in impacts)
    return text.getvalue()


def from_csv(text: str) -> list[Impact]:
    """Read what `as_csv` wrote; raises LogError where it cannot be read."""
    names, *rows = csv.reader(io.StringIO(text))
    if any(len(row) != len(names) for row in rows):
        raise LogError("a row of its table of impacts is cut short")
    return impacts_of({name: [row[number] for row in rows] for number, name in enumerate(names)})


def impact_path(path: Path) -> Path:
    """The file of the impacts beside that of the samples."""
    return path.with_name(f"{path.stem}.{TABLE}{path.suffix}")
