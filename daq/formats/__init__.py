"""Other programs' file formats; a new one is a file here and one line in the table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from daq.errors import LogError
from daq.formats import arrays, comma_separated, mat, parquet, tdms, uff
from daq.formats.contents import FileFormat

FORMATS: Mapping[str, FileFormat] = MappingProxyType(
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


def format_of(path: Path) -> FileFormat:
    """The format of a file by its ending; raises LogError if no format has it."""
    for each in FORMATS.values():
        if path.suffix.lower() in each.suffixes:
            return each
    known = ", ".join(suffix for each in FORMATS.values() for suffix in each.suffixes)
    raise LogError(f"{path}: which format this is cannot be told from its ending; known are {known}")
