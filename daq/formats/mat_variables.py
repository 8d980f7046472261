"""Variables of a MAT file of version 4 or 5.

Taken apart here and not by scipy, which believes the kinds that a file states and looks beyond its tables
where they are none: a damaged file could end the process.

Source: MAT-File Format, The MathWorks, chapter 1 (version 5) and appendix A (version 4).
"""

from __future__ import annotations

import math
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.allowance import MOST_COLUMNS, Allowance
from daq.errors import LogError

_HEAD_BYTES, _ORDER = 128, slice(126, 128)
_ORDERS = {b"IM": "<", b"MI": ">"}
_MATRIX, _COMPRESSED = 14, 15
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CODECS = {1: "latin1", 2: "latin1", 4: "utf-16-{}", 16: "utf-8", 17: "utf-16-{}", 18: "utf-32-{}"}
"""Of texts, by the kind of their element."""
_NUMBERS = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_OTHERS = {1: "cell", 2: "struct", 4: "char", 5: "sparse array", 16: "function"}
"""Classes of MATLAB; any further one is an object."""
_OPAQUE = 17
"""The class of its tables, dates and strings, which has no shape: its name stands there."""
_COMPLEX, _LOGICAL = 8, 2
_NAMED_WITHIN = 4096
"""Bytes of a variable in which its class, shape and name stand."""
_ALL = 1 << 62
_PIECE = 1 << 20
_STORED_4 = ("f8", "f4", "i4", "i2", "u2", "u1")
_KINDS_4 = ("number", "char", "sparse array")


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable; `kind` is `number` or what else it is.

    `read` returns an array, a `char` as one of texts, one row each; a struct of one as a dict, a cell as a
    list; None for what is none of these.
    """

    name: str
    kind: str
    shape: tuple[int, ...]
    read: Callable[[], Any]


def variables(descriptor: int, allowance: Allowance) -> Iterator[Variable]:
    """What is in a file; nothing is in memory until it is read. Raises LogError, ValueError, struct.error."""
    head, size = os.pread(descriptor, _HEAD_BYTES, 0), os.fstat(descriptor).st_size
    if 0 in head[:4]:
        yield from _version_4(descriptor, size, allowance)
        return
    order = _ORDERS.get(head[_ORDER], "")
    if not order:
        raise LogError("it does not begin as a MAT file does")
    at = _HEAD_BYTES
    while at < size:
        kind, length = struct.unpack(f"{order}II", os.pread(descriptor, 8, at))
        content = partial(_content, descriptor, at + 8, length, kind == _COMPRESSED, allowance)
        at += 8 + length
        if at > size:
            raise LogError("its last variable is cut short")
        if kind not in (_MATRIX, _COMPRESSED):
            raise LogError(f"an element of kind {kind} where a variable should begin")
        matrix = _Matrix.of(_whole(content(_NAMED_WITHIN), order, kind), order, allowance)
        if matrix.name:  # one without is MATLAB's own
            read = partial(_read_all, content, order, kind, allowance)
            yield Variable(matrix.name, matrix.kind, matrix.shape, read)


def _read_all(content: Callable[[int], bytes], order: str, kind: int, allowance: Allowance) -> Any:
    return _Matrix.of(_whole(content(_ALL), order, kind), order, allowance).value()


def _whole(content: bytes, order: str, kind: int) -> memoryview:
    """What is in a matrix; that of a compressed one has its tag before it."""
    if kind == _COMPRESSED and struct.unpack_from(f"{order}I", content)[0] != _MATRIX:
        raise LogError("a variable holds no matrix")
    return memoryview(content)[8 if kind == _COMPRESSED else 0 :]


def _content(descriptor: int, at: int, length: int, packed: bool, allowance: Allowance, most: int) -> bytes:
    """At most so many bytes of a variable, unpacked."""
    allowance.spend(records=1)
    if not packed:
        allowance.spend(held=min(length, most))
        return os.pread(descriptor, min(length, most), at)
    unpacking, found, end = zlib.decompressobj(), bytearray(), at + length
    while len(found) < most and at < end and not unpacking.eof:
        data = os.pread(descriptor, min(_PIECE, most, end - at), at)
        at += len(data)
        while data and len(found) < most:
            piece = unpacking.decompress(data, min(_PIECE, most))
            allowance.spend(held=len(piece))
            found += piece
            data = unpacking.unconsumed_tail
    if len(found) < most and not unpacking.eof:
        raise LogError("a compressed variable is cut short")
    return bytes(found)


@dataclass(frozen=True, slots=True)
class _Matrix:
    """A variable, or what stands in a struct or cell, with what of its elements is not yet read."""

    name: str
    number: int
    flags: int
    shape: tuple[int, ...]
    order: str
    rest: Iterator[tuple[int, memoryview]]
    allowance: Allowance

    @classmethod
    def of(cls, content: memoryview, order: str, allowance: Allowance) -> _Matrix:
        parts = _elements(content, order)
        flags = int(_numbers(*_next(parts), order)[0])
        opaque = flags & 0xFF == _OPAQUE
        shape = () if opaque else tuple(int(each) for each in _numbers(*_next(parts), order))
        if len(shape) > 32 or any(each < 0 for each in shape):
            raise LogError(f"a variable of {len(shape)} dimensions, {min(shape)} in one")
        name = bytes(_next(parts)[1]).decode("latin1")
        return cls(name, flags & 0xFF, flags >> 8, shape, order, parts, allowance)

    @property
    def kind(self) -> str:
        if self.number in _NUMBERS:
            return "complex array" if self.flags & _COMPLEX else "number"
        return _OTHERS.get(self.number, "MATLAB object")

    def value(self) -> Any:
        """As `Variable.read`."""
        self.allowance.spend(records=1)
        if self.kind == "number":
            values = _numbers(*_next(self.rest), self.order).reshape(self.shape, order="F")
            wanted = np.dtype(bool if self.flags & _LOGICAL else self.order + _NUMBERS[self.number])
            self.allowance.spend(held=0 if values.dtype == wanted else wanted.itemsize * values.size)
            return values.astype(wanted, copy=False)
        if self.kind == "char":
            return self._texts()
        if self.kind == "struct" and math.prod(self.shape) == 1:
            return dict(zip(self._fields(), self._values(), strict=False))
        return list(self._values()) if self.kind == "cell" else None

    def _texts(self) -> NDArray[Any]:
        kind, data = _next(self.rest)
        self.allowance.spend(held=4 * len(data))
        text = bytes(data).decode(_CODECS[kind].format("le" if self.order == "<" else "be"))
        if self.shape[0] < 2 or not text:
            return np.array([text])
        letters = np.frombuffer(text.encode("utf-32-le"), "<U1").reshape(self.shape[0], -1, order="F")
        return np.ascontiguousarray(letters).view(f"<U{letters.shape[1]}").ravel()

    def _fields(self) -> list[str]:
        longest, names = int(_numbers(*_next(self.rest), self.order)[0]), bytes(_next(self.rest)[1])
        if longest < 1 or len(names) > longest * MOST_COLUMNS:
            raise LogError(f"a struct of {len(names)} letters of fields, {longest} each")
        each = (names[at : at + longest] for at in range(0, len(names), longest))
        return [name.split(b"\0")[0].decode("latin1") for name in each]

    def _values(self) -> Iterator[Any]:
        for kind, data in self.rest:
            if kind != _MATRIX:
                raise LogError(f"an element of kind {kind} in a struct or cell")
            yield _Matrix.of(data, self.order, self.allowance).value() if data else np.empty(0)


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Kind and content of one element after another; each begins at a multiple of eight bytes."""
    at = 0
    while at < len(data):
        kind, length = struct.unpack_from(f"{order}II", data, at)
        begin = at + 8
        if kind >> 16:  # up to four bytes stand in the tag itself
            kind, length, begin = kind & 0xFFFF, min(kind >> 16, 4), at + 4
        if begin + length > len(data):
            raise LogError("an element of a variable is cut short")
        yield kind, data[begin : begin + length]
        at = begin + length + -(begin + length) % 8


def _next(parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    part = next(parts, None)
    if part is None:
        raise LogError("a variable lacks elements")
    return part


def _numbers(kind: int, data: memoryview, order: str) -> NDArray[Any]:
    if kind not in _STORED:
        raise LogError(f"an element of kind {kind} where numbers should be")
    return np.frombuffer(data, order + _STORED[kind])


def _version_4(descriptor: int, size: int, allowance: Allowance) -> Iterator[Variable]:
    at = 0
    while at < size:
        head = os.pread(descriptor, 20, at)
        order = "<" if int.from_bytes(head[:4], "little") < 1000 else ">"
        form, rows, columns, imaginary, letters = struct.unpack(f"{order}5i", head)
        thousands, (stored, kind) = form // 100, divmod(form % 100, 10)
        name = os.pread(descriptor, max(letters, 0), at + 20).rstrip(b"\0").decode("latin1")
        if thousands != (0 if order == "<" else 10) or kind > 2 or min(rows, columns) < 0 or not name:
            raise LogError(f"no variable of a MAT file of version 4 begins at byte {at}")
        dtype = np.dtype(order + _STORED_4[stored])
        at += 20 + letters
        count = rows * columns

        def read(
            at: int = at,
            count: int = count,
            dtype: Any = dtype,
            shape: Any = (rows, columns),
            kind: int = kind,
        ) -> Any:
            allowance.spend(held=2 * count * dtype.itemsize)
            values = np.frombuffer(os.pread(descriptor, count * dtype.itemsize, at), dtype).reshape(
                shape, order="F"
            )
            return np.array(["".join(map(chr, row)) for row in values.astype(int)]) if kind == 1 else values

        yield Variable(name, "complex array" if imaginary else _KINDS_4[kind], (rows, columns), read)
        at += count * dtype.itemsize * (2 if imaginary else 1)
        if at > size:
            raise LogError("its last variable is cut short")
