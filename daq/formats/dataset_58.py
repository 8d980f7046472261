"""Universal file datasets 58 (function at nodal DOF), text and binary ("58b").

Written here and not by pyuff, which writes every NaN as 0 and every sample as a double, one at a time, and
reads a file by taking all of it into memory several times over.

Source: Universal dataset number 58, Structural Dynamics Research Laboratory, University of Cincinnati.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from daq.errors import LogError
from daq.formats.samples import Samples, Scratch, Spooled

HEADER = 151
TIME_RESPONSE = 1
_SEPARATOR = b"    -1"
_EVEN = 1
_REAL_SINGLE, _REAL_DOUBLE = 2, 4
_IEEE = 2
_HEADER_LINES = 11
_ID_LINES = 5
_LONGEST_LINE = 1 << 12
_BATCH_LINES = 1 << 14
ID_WIDTH, LABEL_WIDTH = 80, 20


@dataclass(frozen=True, slots=True)
class Function:
    """The header of a dataset: ID lines, rate as text has it, labels.

    `abscissa_min` and `abscissa_increment` are in s; both 0 where every sample has its own abscissa. `node`
    tells channels apart for programs that go by node and direction.
    """

    id_lines: tuple[str, ...]
    kind: int
    node: int
    count: int
    abscissa_min: float
    abscissa_increment: float
    ordinate_kind: int
    ordinate_label: str
    unit: str


@dataclass(frozen=True, slots=True)
class FoundFunction:
    """A function in a file: `abscissa` is None where spacing is even; `is_real` False where it is complex."""

    function: Function
    is_real: bool
    values: Samples
    abscissa: Samples | None = None


def header(function: Function, dtype: np.dtype[np.floating]) -> bytes:
    """Everything of a binary dataset that stands before its samples; ASCII, as the format asks."""
    data_type = _REAL_SINGLE if dtype.itemsize == 4 else _REAL_DOUBLE
    size = function.count * dtype.itemsize
    ids = [*function.id_lines, *["NONE"] * _ID_LINES][:_ID_LINES]
    lines = [
        _SEPARATOR.decode(),
        f"{58:6d}b{1:6d}{_IEEE:6d}{_HEADER_LINES:12d}{size:12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        *(f"{line[:ID_WIDTH]:<{ID_WIDTH}}" for line in ids),
        f"{function.kind:5d}{function.node:10d}{0:5d}{0:10d}"
        f" {'NONE':<10}{function.node:10d}{0:4d} {'NONE':<10}{0:10d}{0:4d}",
        f"{data_type:10d}{function.count:10d}{_EVEN:10d}"
        f"{function.abscissa_min:13.5e}{function.abscissa_increment:13.5e}{0.0:13.5e}",
        _axis(17, "Time", "s"),
        _axis(function.ordinate_kind, function.ordinate_label, function.unit),
        _axis(0, "NONE", "NONE"),
        _axis(0, "NONE", "NONE"),
    ]
    return "".join(f"{line}\n" for line in lines).encode("ascii")


def run_header(run: str, moment: str) -> bytes:
    """Dataset 151, the head of a file: which run, when, by which program."""
    day, time = moment.split()
    lines = [
        _SEPARATOR.decode(),
        f"{HEADER:6d}{'':74}",
        f"{run or 'NONE':<{ID_WIDTH}}",
        f"{'run of a rig':<{ID_WIDTH}}",
        f"{'rattle':<{ID_WIDTH}}",
        f"{day:<10}{time:<10}{0:10d}{0:10d}{0:10d}",
        f"{day:<10}{time:<10}",
        f"{'rattle':<{ID_WIDTH}}",
        f"{day:<10}{time:<10}",
        _SEPARATOR.decode(),
    ]
    return "".join(f"{line}\n" for line in lines).encode("ascii")


def end() -> bytes:
    """What stands after the samples."""
    return _SEPARATOR + b"\n"


def _axis(kind: int, label: str, unit: str) -> str:
    labels = (f"{text[:LABEL_WIDTH] or 'NONE':<{LABEL_WIDTH}}" for text in (label, unit))
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {' '.join(labels)}"


def functions(file: BinaryIO, scratch: Scratch) -> Iterator[FoundFunction | int]:
    """Functions of a file in turn, and the numbers of datasets of other kinds.

    Binary samples stay where they are in the file, samples in text go to `scratch`. Raises LogError, and
    what Python raises where a header is no header.
    """
    while line := file.readline(_LONGEST_LINE):
        if not line.strip():
            continue
        if line.rstrip() != _SEPARATOR:
            raise LogError(f"no dataset begins at byte {file.tell() - len(line)}")
        line = file.readline(_LONGEST_LINE)
        number = _integer(line[:6], "the number of a dataset")
        if number != 58:
            while (line := file.readline(_LONGEST_LINE)).rstrip() != _SEPARATOR:
                if not line:
                    raise LogError("a dataset has no end")
            yield number
        else:
            yield _function(file, line.decode("ascii", "replace"), scratch)


def _function(file: BinaryIO, first: str, scratch: Scratch) -> FoundFunction:
    lines = [
        file.readline(_LONGEST_LINE).decode("ascii", "replace").rstrip("\r\n") for _ in range(_HEADER_LINES)
    ]
    form, ordinate = lines[6].ljust(80), lines[8].ljust(80)
    data_type, count, spacing = (_integer(form[at : at + 10], "record 7") for at in (0, 10, 20))
    function = Function(
        id_lines=tuple(line.rstrip() for line in lines[:_ID_LINES]),
        kind=_integer(lines[5][:5], "record 6"),
        node=_integer(lines[5][41:51] or 0, "record 6"),
        count=count,
        abscissa_min=_real(form[30:43]),
        abscissa_increment=_real(form[43:56]),
        ordinate_kind=_integer(ordinate[:10], "record 9"),
        ordinate_label=_label(ordinate[25:46]),
        unit=_label(ordinate[46:67]),
    )
    is_double, is_complex = data_type in (4, 6), data_type in (5, 6)
    if data_type not in (2, 4, 5, 6) or count < 0:
        raise LogError(f"dataset 58 with {count} values of data type {data_type}")
    width = (2 if is_complex else 1) + (spacing != _EVEN)
    if first[6:7].lower() == "b":
        values = _binary(file, first, count * width, is_double)
    else:
        # record 12: the fields of a line; an abscissa of its own has 13 characters
        fields: tuple[int, ...] = (13,) * 6 if not is_double else (20,) * 4
        if is_double and spacing != _EVEN:
            fields = (13, 20, 20) if is_complex else (13, 20) * 2
        values = _text(file, count * width, fields, scratch)
    if is_complex:
        return FoundFunction(function, False, values)
    if spacing == _EVEN:
        return FoundFunction(function, True, values)
    return FoundFunction(function, True, Strided(values, 2, 1), Strided(values, 2, 0))


def _binary(file: BinaryIO, first: str, count: int, is_double: bool) -> Samples:
    order, form = _integer(first[7:13], "byte order"), _integer(first[13:19], "floating point format")
    lines, size = _integer(first[19:31], "lines"), _integer(first[31:43], "bytes")
    if form != _IEEE or order not in (1, 2) or lines != _HEADER_LINES:
        raise LogError(f"dataset 58b in floating point format {form}, byte order {order}: only IEEE is read")
    dtype = np.dtype(f"{'<' if order == 1 else '>'}f{8 if is_double else 4}")
    if size != count * dtype.itemsize:
        raise LogError(f"dataset 58b says {size} bytes, and {count} values of {dtype.itemsize} bytes")
    offset = file.tell()
    if file.seek(0, 2) < offset + size:
        raise LogError("the file ends within the samples of a dataset")
    file.seek(offset + size)
    tail = file.readline(_LONGEST_LINE)
    if not tail.strip():  # some programs begin a new line after the samples
        tail = file.readline(_LONGEST_LINE)
    if tail.rstrip(b"\r\n ") != _SEPARATOR:
        raise LogError("the samples of a dataset do not end where it says")
    return Spooled(file.fileno(), offset, count, dtype)


def _text(file: BinaryIO, count: int, widths: tuple[int, ...], scratch: Scratch) -> Samples:
    column, edges = scratch.column(), list(itertools.accumulate(widths, initial=0))
    lines = iter(lambda: file.readline(_LONGEST_LINE), b"")
    data = itertools.takewhile(lambda line: line.rstrip() != _SEPARATOR, lines)
    while batch := list(itertools.islice(data, _BATCH_LINES)):
        fields = (line[low:high] for line in batch for low, high in itertools.pairwise(edges))
        texts = [field.replace(b"D", b"E") for field in fields if field.strip()]  # FORTRAN's exponent
        column.add(np.array(texts, "S20").astype(np.float64))
    if len(column) != count:
        raise LogError(f"a dataset of {count} values holds {len(column)}")
    return column.samples()


@dataclass(frozen=True, slots=True)
class Strided:
    """Every `step`-th number of an interleaved array, from `offset` on."""

    samples: Samples
    step: int
    offset: int

    @property
    def dtype(self) -> np.dtype[np.floating]:
        return np.dtype(self.samples.dtype.newbyteorder("="))

    def __len__(self) -> int:
        return len(self.samples) // self.step

    def read(self, start: int, stop: int) -> NDArray[np.floating]:
        """Read the array there and choose."""
        return self.samples.read(start * self.step, stop * self.step)[self.offset :: self.step]


def _integer(text: str | bytes | int, what: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise LogError(f"{what} is {text!r}") from error


def _real(text: str) -> float:
    try:
        return float(text.replace("D", "E"))
    except ValueError as error:
        raise LogError(f"a number is {text!r}") from error


def _label(text: str) -> str:
    label = text.strip()
    return "" if re.fullmatch(r"(?i)none|", label) else label
