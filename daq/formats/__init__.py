"""Other programs' file formats; a new one is a file here and one line in the table, or an entry point of
another package in the group `rattle.formats` (an object of `daq.formats.contents.FileFormat`)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

from daq.errors import LogError
from daq.formats import arrays, comma_separated, mat, parquet, tdms, uff
from daq.formats.contents import FileFormat
from daq.plugins import plugins

FORMATS = MappingProxyType(
    {
        each.name: each
        for each in (
            uff.FORMAT,
            tdms.FORMAT,
            mat.FORMAT,
            comma_separated.FORMAT,
            parquet.FORMAT,
            arrays.FORMAT,
        )
    }
)


@cache
def all_formats() -> Mapping[str, FileFormat]:
    """Those of the table and of other packages, by name."""
    return FORMATS | plugins("rattle.formats", FileFormat, FORMATS).found


def format_of(path: Path) -> FileFormat:
    """The format of a file by its ending; raises LogError if no format has it."""
    formats = all_formats()
    for each in formats.values():
        if path.suffix.lower() in each.suffixes:
            return each
    known = ", ".join(suffix for each in formats.values() for suffix in each.suffixes)
    raise LogError(f"{path}: which format this is cannot be told from its ending; known are {known}")
