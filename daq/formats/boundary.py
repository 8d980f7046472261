"""Where other programs' files and packages end: new files vanish on failure, the unreadable has one error."""

from __future__ import annotations

import csv
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, BinaryIO
from zipfile import BadZipFile

import pyarrow as pa
from scipy.io.matlab import MatReadError

from daq.errors import LogError, RattleError

_FOREIGN_ERRORS = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    AssertionError,
    ArithmeticError,
    RuntimeError,
    OSError,
    EOFError,
    MemoryError,
    BadZipFile,
    struct.error,
    zlib.error,
    csv.Error,
    pa.ArrowException,
    MatReadError,
)
"""What the TDMS, MAT, Parquet, CSV and NumPy packages raise on damaged input."""


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn what a package raises on a damaged file into LogError with the file's name."""
    try:
        yield
    except LogError as error:
        named = str(error).startswith(f"{path}: ")
        raise LogError(str(error) if named else f"{path}: {error}") from error
    except FileNotFoundError as error:
        raise LogError(f"{path}: {error.strerror}") from error
    except _FOREIGN_ERRORS as error:
        if isinstance(error, RattleError):
            raise
        reason = " ".join(str(error).split())[:200]
        raise LogError(f"{path}: cannot be read ({type(error).__name__}: {reason})") from error


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """A file for reading; whatever goes wrong with it becomes LogError."""
    with readable(path), path.open("rb") as file:
        yield file


@contextmanager
def new_file(path: Path) -> Iterator[IO[bytes]]:
    """Create a file, never over another, and remove it again if it is not completed; raises RattleError."""
    try:
        file = path.open("xb")
    except FileExistsError as error:
        raise RattleError(f"{path} exists already; name another file") from error
    except OSError as error:
        raise RattleError(f"cannot create {path}: {error.strerror}") from error
    try:
        with file:
            yield file
    except BaseException as error:
        path.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, RattleError):
            raise RattleError(f"cannot write {path}: {error.strerror or error}") from error
        raise
