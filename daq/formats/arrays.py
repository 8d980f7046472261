"""Named arrays of any program (MAT, NumPy): vectors are channels, `sample_rate` or `time` says when.

NumPy's .npz and .npy are read here as they are; MAT files of other programs hand their arrays over.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import IO, Any, BinaryIO
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from daq.allowance import Allowance
from daq.errors import LogError
from daq.formats.contents import (
    RATE_NAMES,
    TIME_NAMES,
    Column,
    Contents,
    FileFormat,
    StatedRate,
    TimeAxis,
    opened,
    time_axis,
)
from daq.formats.samples import Scratch, Spooled, precision

_START_NAME = "start_unix_ns"
_UNIT_ENDINGS = (".unit", "_unit")


class Arrays:
    """Collects the arrays of a file, the samples of each in scratch."""

    def __init__(self, scratch: Scratch) -> None:
        self._scratch = scratch
        self._vectors: dict[str, Spooled] = {}
        self._units: dict[str, str] = {}
        self._rate: StatedRate | None = None
        self._start_ns: int | None = None
        self._times: Spooled | None = None
        self.notes: list[str] = []

    def add(self, name: str, array: NDArray[Any]) -> None:
        """Add an array under the name that it has in its file; raises LogError if it makes no sense there."""
        known = name.lower()
        if array.dtype.kind == "U" and array.size == 1:
            ending = next((each for each in _UNIT_ENDINGS if name.endswith(each)), None)
            if ending is None:
                self.notes.append(f"left out: {name}, which is a text")
            else:
                self._units[name.removesuffix(ending)] = str(array.item())
        elif array.dtype.kind not in "fiub":
            self.notes.append(f"left out: {name}, which holds no real numbers")
        elif known in RATE_NAMES and array.size == 1:
            self._rate = StatedRate.exactly(float(array.item()))
        elif known == _START_NAME and array.size == 1:
            self._start_ns = int(array.item())
        elif known in TIME_NAMES:
            self._times = self._scratch.keep(vector(array, name))
        elif array.ndim == 2 and min(array.shape) > 1:
            rows = array if array.shape[0] <= array.shape[1] else array.T  # the longer side is time
            self.notes.append(
                f"{name}: {array.shape[0]} x {array.shape[1]} numbers are {len(rows)} channels of"
                f" {rows.shape[1]} samples, named {name}.1 to {name}.{len(rows)}"
            )
            for number, row in enumerate(rows, start=1):
                self._vectors[f"{name}.{number}"] = self._scratch.keep(row)
        elif array.size > 1:
            self._vectors[name] = self._scratch.keep(vector(array, name))
        else:
            self.notes.append(f"left out: {name}, which holds {array.size} number{'s' * (array.size != 1)}")

    def contents(self) -> Contents:
        """All columns; raises LogError where time and samples do not go together."""
        axis = TimeAxis(None, 0.0) if self._times is None else time_axis(self._times)
        if self._times is not None:
            wrong = [
                f"{name} ({len(each)})"
                for name, each in self._vectors.items()
                if len(each) != len(self._times)
            ]
            if wrong:
                raise LogError(f"not as long as its {len(self._times)} times: {', '.join(wrong)}")
        columns = [
            Column(
                name,
                samples,
                unit=self._units.get(name),
                rate=self._rate or axis.rate,
                start_ns=self._start_ns,
                start_s=axis.start_s,
            )
            for name, samples in self._vectors.items()
        ]
        return Contents(tuple(columns), notes=self.notes)


def vector(array: NDArray[Any], name: str) -> NDArray[Any]:
    """An array as one row of numbers, shape (n,); raises LogError if it is none."""
    precision(array.dtype)
    if array.size != max(array.shape, default=1):
        raise LogError(f"{name} is {' x '.join(map(str, array.shape))} numbers, no row of samples")
    return np.ravel(array)


def read(path: Path, scratch: Scratch) -> Contents:
    """Read the arrays of a file, or the fields of a structured array; raises LogError."""
    arrays = Arrays(scratch)
    with opened(path) as file:
        for name, array in named(path, file):
            arrays.add(name, array)
        return arrays.contents()


def named(path: Path, file: BinaryIO) -> Iterator[tuple[str, NDArray[Any]]]:
    """The arrays of a file, or the fields of a structured array, with their names.

    Nothing in the file is run: pickled objects are refused.
    """
    head = file.read(len(np.lib.format.MAGIC_PREFIX))
    file.seek(0)
    if head != np.lib.format.MAGIC_PREFIX:
        if not is_zipfile(file):
            raise LogError("neither an array of NumPy nor a .npz of several")
        file.seek(0)
        allowance = Allowance(path, file.fileno())
        with np.load(file, allow_pickle=False) as several:
            for each in several.zip.infolist():
                allowance.spend(held=each.file_size, records=1)
                with several.zip.open(each) as member:
                    yield each.filename.removesuffix(".npy"), _array(member, each.file_size)
        return
    loaded = _array(file, path.stat().st_size)
    if loaded.dtype.names is None:
        yield "array", loaded
    elif loaded.ndim != 1:
        raise LogError(f"a structured array of {loaded.ndim} dimensions")
    else:
        for name in loaded.dtype.names:
            yield name, loaded[name]


def _array(file: IO[bytes], size: int) -> NDArray[Any]:
    """The array of a file of so many bytes; raises LogError where it says that it has more."""
    first = np.lib.format.read_magic(file) == (1, 0)
    header = np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
    shape, _, dtype = header(file)
    if (held := prod(shape) * dtype.itemsize) > size:
        raise LogError(f"an array of {held} bytes in a file of {size}")
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)


FORMAT = FileFormat("numpy", (".npz", ".npy"), read)
